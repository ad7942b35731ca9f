# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""List the scripts that write the tables and pictures of the documentation.

python -m tools
"""

import argparse

from tools.catalogue import scripts


def main() -> None:
    """Print one paragraph for each script."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    for script in scripts():
        print(f"python -m {script.module}\n    {script.purpose}")
        for target in script.writes:
            print(f"    writes {target}")
        if script.prints:
            print(f"    prints {script.prints}")
    print("\nEach script has --help. tools/headless_viewer.py draws recordings for scripts and tests.")


if __name__ == "__main__":
    main()
