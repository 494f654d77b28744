"""Options of `weldcell calibrate tcp`."""

import argparse
from pathlib import Path

from weldcell.scenarios import options


def add_tcp(kinds: "argparse._SubParsersAction[options.Parser]", everywhere: options.Parser) -> None:
    """Adds the command to those of `weldcell calibrate`."""
    tcp = kinds.add_parser(
        "tcp",
        parents=[everywhere],
        help="where the torch's tip is on the flange, from touches",
        description="Where the torch's tip is on the flange. pivot: the tip touches one fixed point in 4 or more poses "
        "that turn about two axes (6 or more tell a wrong one). sphere: the tip touches a fixed sphere all over.",
    )
    tcp.set_defaults(parser=tcp)
    add = tcp.add_argument
    add("--poses", metavar="FILE.csv", type=Path, required=True, help="flange in the base at each touch, a row a pose")
    add("--method", choices=("pivot", "sphere"), default="pivot", help="what was touched (default: pivot, one point)")
    add("--radius-mm", metavar="MM", type=float, help="the sphere's radius")
    add("--tip-radius-mm", metavar="MM", type=float, default=0.0, help="radius of the tip's rounding (default: 0)")
    add("--tcp-mm", metavar=("X", "Y", "Z"), nargs=3, type=float, help="nominal tip in the flange, for the sphere")
    add("--euler", metavar="SEQ", help="rotation of rx,ry,rz: XYZ about the moving axes, xyz about the fixed ones")
    add("--out", metavar="DIR", type=Path, required=True, help="where result.json goes")
    add("--overwrite", action="store_true", help="replace a result (default: refuse)")


def calibrate(parsed: argparse.Namespace) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons of the command as parsed."""
    from weldcell.scenarios import calibrate_tcp  # SciPy takes its time to import

    return calibrate_tcp.tcp(
        calibrate_tcp.TcpRequest(
            method=parsed.method,
            poses_file=parsed.poses,
            euler=parsed.euler,
            radius_m=None if parsed.radius_mm is None else parsed.radius_mm * 1e-3,
            tip_radius_m=parsed.tip_radius_mm * 1e-3,
            tip_flange=None if parsed.tcp_mm is None else tuple(value * 1e-3 for value in parsed.tcp_mm),
        ),
        parsed.out,
        overwrite=parsed.overwrite,
    )
