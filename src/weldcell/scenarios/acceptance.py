"""What a run must reach to pass: to be no worse than what paper P2 published of its real cell (its Tables 1 to 3).

For the light plane there is nothing published: the limits of the boards' methods are what 15 pictures must give at the
camera's own noise. P1 publishes no figure of its U seam, only a plot of the fitted track (its Fig. 9): by either method
its centre has the limit of P2's root. A weld must do what others publish of seam tracking: 0.16 mm in the mean (lap and
butt joints), 0.5 mm at most (in strong arc light).
"""

from collections.abc import Mapping

LIMITS = {
    "point_1_error_after_mm": 0.8183,
    "point_2_error_after_mm": 0.7069,
    "point_3_error_after_mm": 0.6371,
    "seam_left_mean_error_mm": 0.4567,
    "seam_root_mean_error_mm": 0.6374,
    "seam_right_mean_error_mm": 0.4856,
    "seam_centre_mean_error_mm": 0.6374,
    "seam_centre_morphological_mean_error_mm": 0.6374,
    "torch_lateral_mean_error_mm": 0.16,
    "torch_lateral_max_error_mm": 0.5,
    "boss_edge_mean_error_mm": 0.5071,
    "boss_angle_mean_error_deg": 0.2145,
    "vanishing_point_theta_error_deg": 0.015,
    "board_theta_error_deg": 0.01,
    "board_plane_rms_um": 15.0,
    "bundle_theta_error_deg": 0.01,
    "bundle_plane_rms_um": 15.0,
    "camera_held_out_rms_px": 0.1,
}

VALID_SHARE = 0.98
"""Of the frames along a seam (ours: the paper gives none)."""


def limits_for(metrics: Mapping[str, float | None]) -> dict[str, float]:
    """The limits of those metrics that have one."""
    return {name: limit for name, limit in LIMITS.items() if name in metrics}


def failures(metrics: Mapping[str, float | None]) -> tuple[str, ...]:
    """What else makes a run unacceptable, in words."""
    valid, frames = metrics.get("frames_valid_count"), metrics.get("frames_count")
    if valid is None or frames is None or valid >= VALID_SHARE * frames:
        return ()
    return (f"the seam was found in {valid:.0f} of {frames:.0f} frames, expected at least {VALID_SHARE:.0%}",)
