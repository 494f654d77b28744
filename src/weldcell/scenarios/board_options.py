"""Options of `weldcell calibrate camera` and `weldcell calibrate laser-plane`."""

import argparse
from pathlib import Path

from weldcell.scenarios import options

_SHOW = "pictures (PNG, JPEG, TIFF, BMP; after -- if a name starts with a dash)"


def add_boards(kinds: "argparse._SubParsersAction[options.Parser]", everywhere: options.Parser) -> None:
    """Adds both commands to those of `weldcell calibrate`."""
    camera = kinds.add_parser(
        "camera",
        parents=[everywhere],
        help="intrinsics from pictures of a chessboard",
        usage="weldcell calibrate camera IMAGE... --board COLSxROWS --square-mm S [--lens plain|tilted] --out DIR",
        description="Intrinsics from pictures of one flat chessboard, leaning differently in each (10 or more, leaning "
        "up to 45 deg, all over the view).",
    )
    plane = kinds.add_parser(
        "laser-plane",
        parents=[everywhere],
        help="the light plane from pictures that show chessboard and stripe at once",
        usage="weldcell calibrate laser-plane IMAGE... --board COLSxROWS --square-mm S [--camera camera.yaml] "
        "[--along rows|columns|auto] --out DIR",
        description="The light plane from pictures of one flat chessboard with the laser stripe on it, at different "
        "distances and leans. Without --camera the intrinsics are estimated from the same pictures.",
    )
    for command in (camera, plane):
        command.set_defaults(parser=command)
        add = command.add_argument
        add("images", metavar="IMAGE", nargs="+", type=Path, help=_SHOW)
        add("--board", metavar="COLSxROWS", required=True, help="inner corners of the chessboard, e.g. 11x8")
        add("--square-mm", metavar="S", type=float, required=True, help="side of a square")
        add("--lens", choices=("plain", "tilted"), default="plain", help="tilted: Scheimpflug (default: plain)")
        add("--out", metavar="DIR", type=Path, required=True, help="where result.json and residuals.png go")
        add("--overwrite", action="store_true", help="replace a result (default: refuse)")
    plane.add_argument("--camera", metavar="FILE.yaml", type=Path, help="camera.yaml of `weldcell calibrate camera`")
    plane.add_argument(
        "--along",
        choices=("rows", "columns", "auto"),
        default="auto",
        help="what the stripe runs along in the pictures (default: auto)",
    )


def calibrate(parsed: argparse.Namespace) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons of the command as parsed."""
    from weldcell.scenarios import calibrate_boards  # OpenCV and SciPy take their time to import

    request = calibrate_boards.BoardRequest(
        images=tuple(parsed.images),
        board=parsed.board,
        square_mm=parsed.square_mm,
        lens=parsed.lens,
        camera_file=getattr(parsed, "camera", None),
        along=getattr(parsed, "along", "auto"),
    )
    run = calibrate_boards.camera if parsed.kind == "camera" else calibrate_boards.plane
    return run(request, parsed.out, overwrite=parsed.overwrite)
