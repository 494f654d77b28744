"""The light plane by every method, on pictures of the same boards, against the truth."""

from weldcell.cell.randomness import generator
from weldcell.scenarios.acceptance import limits_for
from weldcell.scenarios.board_bench import BoardBench
from weldcell.scenarios.camera_file import camera_mapping
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.laser_plane_methods import METHODS, MethodResult, drawn_plane, errors, noise_table, solve_all
from weldcell.scenarios.laser_plane_sights import Boards, LaserPlaneSights, take_sights
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.results_table import results_markdown


def run(job: Job) -> Outcome:
    """How well each method tells the light plane."""
    boards, plan = Boards(job.config, job.seed), job.config.laser_plane
    title = f"{job.scenario}, sensor {job.config.sensor.preset}, seed {job.seed}"
    with (
        Recording(job.recording_path, job.config.recording, title=title) as recording,
        BoardBench(job.config, job.seed, recording, boards.all) as bench,
    ):
        sights = take_sights(bench, boards, recording, job.progress)
        drawn = drawn_plane(bench.plane, generator(job.seed, "boards/drawing"))
        found, truth = solve_all(sights, drawn, boards.tilted), (bench.camera, bench.plane)
        metrics = {
            f"{name}_{quantity}": value for name in METHODS for quantity, value in errors(found[name], *truth).items()
        }
        metrics["camera_held_out_rms_px"] = sights.camera.held_out_rms_px
        metrics |= noise_table(
            sights,
            drawn,
            truth,
            levels_px=plan.noise_px,
            repeats=plan.noise_repeats,
            tilted=boards.tilted,
            axis=1 if boards.along == "rows" else 0,
            seed=job.seed,
        )
        _write(job, sights, found)
        outcome = Outcome(metrics=metrics, limits=limits_for(metrics), failures=_refusals(found))
        recording.log_text("results", f"# Laser plane\n\n{results_markdown(outcome)}")
        return outcome


def _refusals(found: dict[str, MethodResult]) -> tuple[str, ...]:
    return tuple(
        f"{name.replace('_', ' ')} refused: {'; '.join(one.reasons)}"
        for name, one in found.items()
        if one.verdict == "refused"
    )


def _write(job: Job, sights: LaserPlaneSights, found: dict[str, MethodResult]) -> None:
    job.write_calibration("camera", camera_mapping(sights.camera.camera) | {"rms_px": sights.camera.rms_px})
    for name, one in found.items():
        job.write_calibration(
            f"laser_plane_{name}",
            {
                "normal": one.plane.normal_camera,
                "offset_mm": 1e3 * one.plane.offset_m,
                "covariance": one.covariance,
                "covariance_order": "normal's tilts along the laser frame's x and z (rad), offset (m)",
                "condition_number": one.condition_number,
                "verdict": one.verdict,
                "reasons": list(one.reasons),
                "camera": camera_mapping(one.camera),
            },
        )
