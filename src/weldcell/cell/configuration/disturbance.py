"""What disturbs the sensor, and when."""

from dataclasses import dataclass
from typing import Literal

from weldcell.cell.configuration.bounds import Unsigned
from weldcell.cell.errors import BadInput

DisturbanceKind = Literal["arc", "spatter", "fume", "stripe-lost", "sensor-knocked", "stuck-exposure"]


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Something that disturbs the sensor between two times of a job."""

    kind: DisturbanceKind
    """What happens."""
    start_s: Unsigned = 0.0
    """When it begins."""
    end_s: Unsigned = 1e6
    """When it is over."""
    strength: Unsigned = 1.0
    """How strong it is, as a multiple of the usual."""

    def __post_init__(self) -> None:
        if self.end_s < self.start_s:
            found = f"{self.kind} from {self.start_s:g} to {self.end_s:g} s"
            raise BadInput(f"found {found}, expected the smaller one first")
