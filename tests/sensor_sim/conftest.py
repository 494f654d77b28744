"""Small scenes and the nominal sensor above them; the light falls straight down, the camera looks at 45 degrees."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.frames import rigid_from
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.laser import LaserFan, laser_fan

Scene = tuple[mujoco.MjModel, mujoco.MjData]


@pytest.fixture(scope="session")
def config() -> SensorConfig:
    return SensorConfig()


@pytest.fixture(scope="session")
def fan(config: SensorConfig) -> LaserFan:
    """The nominal fan, two rays for each column."""
    return laser_fan(config, nominal_plane(config), nominal_source_camera(config))


@pytest.fixture(scope="session")
def camera(config: SensorConfig):
    return nominal_camera(config)


@pytest.fixture(scope="session")
def overhead() -> Callable[..., RigidTransform]:
    """T_base_camera whose light plane holds the vertical through `target`, the crossing point being the target."""

    def pose(target=(0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> RigidTransform:
        forward = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2)
        across = np.array([0.0, 1.0, 0.0])
        R = Rotation.from_euler("z", yaw_rad).as_matrix() @ np.column_stack(
            [across, np.cross(forward, across), forward]
        )
        return rigid_from(Rotation.from_matrix(R), np.asarray(target) - 0.275 * R[:, 2])

    return pose


@pytest.fixture(scope="session")
def scene() -> Callable[[str], Scene]:
    """Model and data of a world body's MJCF (and optional assets), kinematics up to date."""

    def build(world: str, asset: str = "") -> Scene:
        model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{asset}</asset><worldbody>{world}</worldbody></mujoco>")
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        return model, data

    return build
