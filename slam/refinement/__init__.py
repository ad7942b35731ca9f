# SPDX-License-Identifier: MIT
"""The final pass: all poses of a recording adjusted together, and the map drawn from them."""
