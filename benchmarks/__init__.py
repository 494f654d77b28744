"""Workloads and peers; fabricated data are the tests' own."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent.parent / "tests"))
