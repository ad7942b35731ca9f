"""Scripts that write the tables and pictures of the documentation; `python -m tools` lists them."""
