"""Numbers with the bounds that fields of several sections share."""

from typing import Annotated

from annotated_types import Ge, Gt, Le

Positive = Annotated[float, Gt(0), Le(1e6)]
Unsigned = Annotated[float, Ge(0), Le(1e6)]
Finite = Annotated[float, Ge(-1e6), Le(1e6)]
Angle = Annotated[float, Ge(-89), Le(89)]
Point = tuple[Finite, Finite, Finite]
Share = Annotated[float, Ge(0), Le(1)]
