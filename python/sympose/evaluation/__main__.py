"""`python -m sympose.evaluation`."""

import sys

from sympose.evaluation.cli import main

if __name__ == "__main__":
    sys.exit(main())
