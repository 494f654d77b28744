"""The arm's drives: servos that follow commanded readings, and the arm's own dynamics that they work against.

Each axis has the cascade of industrial controllers (Gross, Hamann, Wiegaertner 2001, "Electrical Feed Drives in
Automation Technology"): a position loop P, inside it a velocity loop PI on the motor's encoder, inside it a torque
that is given at once, up to what the motor can. With e = q* - q the error of position and w that of velocity:

    w = Kv e + [q*'] - q',      torque = Kp (w + integral of w / Ti) + [computed torque];

what stands in brackets is the feed-forward. The computed torque is that of the arm and the friction that the
controller knows, at the commanded motion; the actual arm's links and friction are others. All is at the joint, on the
motor's side: the gears' elasticity is not stepped (it rings at 17 Hz and more). What it gives way
under gravity, and repeatability, are `Cell.take`'s, which takes the readings that come out of here.

With a for the velocity loop's bandwidth and J for the axis' inertia: Kp = a J and Ti = 4 / a (critically damped); Kv is
31 1/s (geared axes have 20 to 40), a fifth of the slowest a. A torque D that is not known makes an axis err by
D / J x s / (s^3 + a s^2 + (a Kv + a^2/4) s + a^2 Kv / 4). So:

- Without feed-forward a steady motion lags by q' / Kv, whatever the torque, as the integral leaves no w.
- With it, an arm and a friction as known don't err at all.
- A friction that is d more than known shows where the joint turns back, as a step of D = 2 d. The error that follows
  grows to 1.95 D / (J a^2) within 32 ms in axes 1 and 2 (the others: 2.31, 23 ms) and is gone after 0.15 s.

Time is counted as a digital servo does: at t_k it reads the encoder, whose difference over the last period is the rate
in that period's middle, and sets the torque until t_k+1. MuJoCo's semi-implicit step is the same leapfrog.
"""

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.errors import BadInput
from weldcell.cell.world.bare_arm import BareArm
from weldcell.cell.world.cell import Cell
from weldcell.cell.world.dry_friction import DryFriction
from weldcell.cell.world.robot_error import JOINTS

_PRESLIDING_RAD = 5e-5  # geared joints turn 0.1 to 0.5 arc minutes before they slide (data sheets' hysteresis)
# Bandwidth of the velocity loops: about where the gears ring, as is usual (1.5 urad/Nm on 30 kg m2: 24 Hz, on 8 kg m2:
# 45 Hz); the wrist's ring at 80 Hz and above (6 urad/Nm on 0.6 kg m2), which a servo of 1 kHz leaves room to.
_VELOCITY_RAD_S = 2 * np.pi * np.array([25.0, 25.0, 40.0, 40.0, 40.0, 40.0])
_VELOCITY_PERIODS = 0.3  # and no faster than this for each servo period, which a slow servo could not hold stable
_LONGEST_STEP_S = 1e-3  # of the physics; a slower servo has several in a period


class Drives:
    """The moving arm: its joints' angles and rates, and what its servos remember."""

    def __init__(self, cell: Cell, known_cell: Cell, servo_hz: float = 1000.0, *, feed_forward: bool = True) -> None:
        """The drives of the actual arm in `cell`; their controller knows that of `known_cell`."""
        if not 100 <= servo_hz <= 1e5:
            raise BadInput(f"drives: servo_hz is {servo_hz}, expected 100 to 100000")
        self.period_s = 1 / servo_hz
        self._steps = int(np.ceil(self.period_s / _LONGEST_STEP_S - 1e-9))
        self._arm = BareArm(cell.model, self.period_s / self._steps)
        self._known = BareArm(known_cell.model, self.period_s)
        self._zero_rad = cell.error.zero_rad
        self._feed_forward = feed_forward
        self._velocity_rad_s = np.minimum(_VELOCITY_RAD_S, _VELOCITY_PERIODS * servo_hz)
        known = [known_cell.model.joint(f"arm/joint_{k + 1}") for k in range(JOINTS)]
        self._viscous_nms_rad = np.array([joint.damping[0] for joint in known])
        coulomb_nm = np.array([joint.frictionloss[0] for joint in known])
        self.limits_nm = np.array([known_cell.model.actuator(f"arm/motor_{k + 1}").ctrlrange[1] for k in range(JOINTS)])
        self._friction_ratio = 1 + cell.error.friction_ratio
        self._friction = DryFriction(coulomb_nm * self._friction_ratio, _PRESLIDING_RAD)
        self._known_friction = DryFriction(coulomb_nm, _PRESLIDING_RAD)
        self.start(np.zeros(JOINTS))

    def start(self, readings_rad: Float[np.ndarray, "6"]) -> None:
        """Puts the arm at rest at these readings, held by its servos."""
        readings_rad, still = np.array(readings_rad, float), np.zeros(JOINTS)
        self._command: tuple[Float[np.ndarray, "6"], ...] = (readings_rad, still, still)
        self._friction.release()
        self._known_friction.release()
        self._arm.put(readings_rad + self._zero_rad)
        holding_nm = self._arm.torque_nm(readings_rad + self._zero_rad, still, still)
        # For the inertias of this posture: within a path they change little, and a gain that jumps jerks.
        self._gain_nms = self._velocity_rad_s * self._known.inertias_kgm2(readings_rad)
        self._integral_nm = holding_nm - self._computed_nm()
        self.saturated: Bool[np.ndarray, "6"] = np.zeros(JOINTS, bool)
        """Drives that could not give the torque that they were asked for, at any time since the start."""

    @property
    def position_gain_1_s(self) -> float:
        """Kv, the same for all axes, as paths need it: without feed-forward a steady motion lags by its rate / Kv."""
        return float(self._velocity_rad_s.min()) / 5

    @property
    def readings_rad(self) -> Float[np.ndarray, "6"]:
        """What the encoders show now."""
        return self._arm.angles_rad - self._zero_rad

    @property
    def rates_rad_s(self) -> Float[np.ndarray, "6"]:
        """The joints' rates, as the encoders' difference over the last step shows them."""
        return self._arm.rates_rad_s

    def step(
        self,
        command_rad: Float[np.ndarray, "6"],
        rates_rad_s: Float[np.ndarray, "6"],
        accelerations_rad_s2: Float[np.ndarray, "6"],
    ) -> Float[np.ndarray, "6"]:
        """The readings a servo period later, commanded to be at `command_rad` by then, with these rates."""
        return self.follow(command_rad[None], rates_rad_s[None], accelerations_rad_s2[None])[0]

    def follow(
        self,
        commands_rad: Float[np.ndarray, "n 6"],
        rates_rad_s: Float[np.ndarray, "n 6"],
        accelerations_rad_s2: Float[np.ndarray, "n 6"],
    ) -> Float[np.ndarray, "n 6"]:
        """The readings at the end of each of n servo periods, commanded to be at `commands_rad` by then."""
        motion = [np.array(part, float) for part in (commands_rad, rates_rad_s, accelerations_rad_s2)]
        if not all(np.isfinite(part).all() for part in motion):
            raise BadInput(
                "drives: found a command that is not a number, expected finite readings, rates, accelerations"
            )
        readings_rad = np.empty((len(commands_rad), JOINTS))
        for k, command in enumerate(zip(*motion, strict=True)):
            self._push(self._torque_nm())
            self._known_friction.turn(command[0] - self._command[0])
            self._command = command
            readings_rad[k] = self.readings_rad
        return readings_rad

    def torque_shares(
        self,
        commands_rad: Float[np.ndarray, "n 6"],
        rates_rad_s: Float[np.ndarray, "n 6"],
        accelerations_rad_s2: Float[np.ndarray, "n 6"],
    ) -> Float[np.ndarray, "n 6"]:
        """Share of each drive's largest torque that a motion takes, dry friction apart, as the controller knows."""
        motion = zip(commands_rad, rates_rad_s, accelerations_rad_s2, strict=True)
        torques_nm = np.array([self._known.torque_nm(*command) for command in motion]).reshape(-1, JOINTS)
        return np.abs(torques_nm + self._viscous_nms_rad * rates_rad_s) / self.limits_nm

    def _torque_nm(self) -> Float[np.ndarray, "6"]:
        """What the servos give in the coming period."""
        command_rad, rates_rad_s, accelerations_rad_s2 = self._command
        wanted_rad_s = self.position_gain_1_s * (command_rad - self.readings_rad)
        if self._feed_forward:  # the encoder's rate is that of half a step ago
            wanted_rad_s = wanted_rad_s + rates_rad_s - 0.5 * self.period_s / self._steps * accelerations_rad_s2
        proportional_nm = self._gain_nms * (wanted_rad_s - self.rates_rad_s)
        asked_nm = proportional_nm + self._integral_nm + self._computed_nm()
        given_nm = np.clip(asked_nm, -self.limits_nm, self.limits_nm)
        short = given_nm != asked_nm
        self.saturated = self.saturated | short
        learnt_nm = proportional_nm * (self.period_s * self._velocity_rad_s / 4)
        self._integral_nm = self._integral_nm + np.where(short, 0.0, learnt_nm)  # a saturated loop does not wind up
        return given_nm

    def _computed_nm(self) -> Float[np.ndarray, "6"]:
        """The feed-forward of torque."""
        if not self._feed_forward:
            return np.zeros(JOINTS)
        friction_nm = self._known_friction.torque_nm + self._viscous_nms_rad * self._command[1]
        return self._known.torque_nm(*self._command) + friction_nm

    def _push(self, torque_nm: Float[np.ndarray, "6"]) -> None:
        """Moves the actual arm on by a servo period under the motors' torque and its own friction."""
        for _ in range(self._steps):
            viscous_nm = self._friction_ratio * self._viscous_nms_rad * self._arm.rates_rad_s
            before_rad = self._arm.angles_rad
            self._arm.step(torque_nm - viscous_nm - self._friction.torque_nm)
            self._friction.turn(self._arm.angles_rad - before_rad)
