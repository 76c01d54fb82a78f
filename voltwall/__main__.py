"""The program, as `voltwall` and as `python -m voltwall`."""

import sys

from app.cli import main

if __name__ == "__main__":
    sys.exit(main())
