"""How the materials of parts look in rendered pictures; what they do to the laser's light is `sensor_sim`'s matter."""

from weldcell.cell.configuration import MaterialName
from weldcell.models.mesh_body import Finish

FINISHES: dict[MaterialName, Finish] = {
    "matt-white": Finish(rgba=(0.80, 0.80, 0.79, 1.0), specular=0.05, shininess=0.1),
    "mill-scale": Finish(rgba=(0.17, 0.17, 0.19, 1.0), specular=0.10, shininess=0.15),
    "ground-steel": Finish(rgba=(0.52, 0.53, 0.54, 1.0), specular=0.30, shininess=0.3),
    "stainless": Finish(rgba=(0.58, 0.58, 0.58, 1.0), specular=0.50, shininess=0.5),
    "aluminium": Finish(rgba=(0.72, 0.73, 0.75, 1.0), specular=0.45, shininess=0.45),
    "polished": Finish(rgba=(0.20, 0.205, 0.215, 1.0), specular=0.90, shininess=0.9),
}
"""MuJoCo draws no reflections of surroundings: polished steel, which shows little else, is dark with highlights."""
