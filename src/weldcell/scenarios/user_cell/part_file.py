"""The user's own part: a small YAML file beside a mesh, with its seam as a polyline or picked from sharp edges."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from weldcell.cell.configuration import MaterialName
from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.models.own_part import OwnPart, SeamLines, SeamPick, Unit, Up, own_part
from weldcell.models.sharp_edges import EdgeKind
from weldcell.scenarios.settings import check_section
from weldcell.scenarios.user_cell.jail import named_file, shown
from weldcell.scenarios.user_cell.mesh_file import read_mesh
from weldcell.scenarios.user_cell.seam_file import read_seam
from weldcell.scenarios.yaml_file import read_yaml

_Coordinate = Annotated[float, Ge(-1e6), Le(1e6)]


@dataclass(frozen=True, kw_only=True)
class PartFile:
    """What the YAML file of a part holds. Names of files are relative to its folder, and stay in it."""

    file: str
    """The mesh (.stl .obj .ply .glb) or the solid (.step .stp, with the extra `step`)."""
    units: Unit | None = None
    """Unit of the mesh; left out, it is the format's own, or guessed from the size."""
    up: Up | None = None
    """Axis of the file that points up; left out, z (GLB: y)."""
    material: MaterialName = "ground-steel"
    """What the surface is."""
    seam_file: str | None = None
    """The seam as a polyline: x_mm,y_mm,z_mm and perhaps feature, in the mesh's own frame."""
    seam_near_mm: tuple[_Coordinate, _Coordinate, _Coordinate] | None = None
    """Instead: the line of sharp edges nearest to this point of the mesh's own frame, from its nearer end on."""
    seam_edges: EdgeKind = "all"
    """Which sharp edges count: inner corners, outer corners, or all (with the rims of open surfaces)."""
    seam_sharper_than_deg: Annotated[float, Ge(1.0), Le(179.0)] = 30.0
    """Least angle between the faces' normals on either side of a sharp edge."""


def read_part(path: Path, name: str = "own_part") -> OwnPart:
    """The part of a YAML file; its body will be called `name`. Raises BadInput that names file and field."""
    told = check_section(PartFile, read_yaml(path), shown(path), between=": ")
    mesh_path = named_file(path.parent, told.file, f"{shown(path)}: file")
    where = f"{shown(path)}: file: {shown(told.file)}"
    seam = _seam(path, told)
    try:
        return own_part(
            read_mesh(mesh_path, where),
            name=name,
            unit=told.units,
            up=told.up,
            seam=seam,
            material=told.material,
        )
    except BadGeometry as refusal:
        raise BadInput(f"{where}: {refusal}") from refusal


def _seam(path: Path, told: PartFile) -> SeamLines | SeamPick | None:
    if told.seam_file is not None and told.seam_near_mm is not None:
        raise BadInput(f"{shown(path)}: found seam_file and seam_near_mm, expected one of the two")
    if told.seam_file is not None:
        where = f"{shown(path)}: seam_file"
        return read_seam(named_file(path.parent, told.seam_file, where), f"{where}: {shown(told.seam_file)}")
    if told.seam_near_mm is None:
        return None
    near = 1e-3 * np.array(told.seam_near_mm)
    return SeamPick(
        near_m=(float(near[0]), float(near[1]), float(near[2])),
        sharper_than_rad=float(np.radians(told.seam_sharper_than_deg)),
        kind=told.seam_edges,
    )
