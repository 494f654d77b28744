"""`python -m weldcell` does what the command `weldcell` does."""

import sys

from weldcell.scenarios.command_line import main

if __name__ == "__main__":
    sys.exit(main())
