"""The boss scanned from two opposite sides, cut into planes, and measured."""

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import JobFailed
from weldcell.scenarios.scanning import ScanPath, scan
from weldcell.scenarios.station import Station
from weldcell.scenarios.verification import Alignment
from weldcell.tracking.boss import BossMeasure, measure_boss
from weldcell.tracking.planes import fit_planes

_MARGIN_M = 0.012  # of the base slab that is scanned before and behind the slopes
_COLUMN_STEP = 2  # every other column: neighbouring stripe centres share their blur, so little is lost
