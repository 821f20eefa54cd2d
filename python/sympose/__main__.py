"""`python -m sympose`: the command line."""

import sys

from sympose.cli import main

if __name__ == "__main__":
    sys.exit(main())
