"""The command `weldcell`."""

import argparse
import os
import sys
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path

import weldcell
from weldcell.cell.errors import BadInput, JobFailed, WeldcellError
from weldcell.scenarios import board_options, options, tcp_options
from weldcell.scenarios.catalogue import SCENARIOS, Scenario, did_you_mean, find_scenario
from weldcell.scenarios.run_folder import recording_of

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT, EXIT_INTERRUPTED, EXIT_PIPE_CLOSED = 0, 1, 2, 130, 141


def main(arguments: Sequence[str] | None = None, scenarios: Iterable[Scenario] = SCENARIOS) -> int:
    """The exit code: 0 done, 1 the run's own acceptance failed, 2 bad input or configuration."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    scenarios = tuple(scenarios)
    try:
        return _dispatch(_parse(arguments, scenarios), scenarios)
    except JobFailed as error:
        return _explain(arguments, EXIT_FAILED, "failed", str(error))
    except WeldcellError as error:
        return _explain(arguments, EXIT_BAD_INPUT, "error", str(error))
    except BrokenPipeError:  # the reader of our output had enough, as in `weldcell list | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_PIPE_CLOSED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _explain(arguments, EXIT_BAD_INPUT, "error", f"{where}{error.strerror or error}")
    except KeyboardInterrupt as interrupt:
        return _explain(arguments, EXIT_INTERRUPTED, "error", str(interrupt) or "interrupted; nothing was left behind")
    except Exception as error:
        what = f"unexpected {type(error).__name__}: {error} (--debug shows where; please report it)"
        return _explain(arguments, EXIT_BAD_INPUT, "error", what)


def _explain(arguments: Sequence[str], code: int, kind: str, message: str) -> int:
    if "--debug" in arguments:
        traceback.print_exc()
    print(f"weldcell: {kind}: {_one_line(message)}", file=sys.stderr)
    return code


def _say(message: str) -> None:
    print(_one_line(message), flush=True)


def _one_line(message: str) -> str:
    """The message in one line whatever a file is called, and printable whatever the terminal's encoding."""
    line = " ".join(message.splitlines()) or "no reason given"
    encoding = sys.stderr.encoding or "utf-8"
    return line.encode(encoding, "backslashreplace").decode(encoding)


def _parse(arguments: Sequence[str], scenarios: Iterable[Scenario]) -> argparse.Namespace:
    parser, commands = _parser(scenarios)
    parsed, unknown = parser.parse_known_args(options.normalised(arguments))
    if unknown:
        command = getattr(parsed, "parser", commands.choices[parsed.command])  # of `calibrate KIND`
        hint = did_you_mean(unknown[0].partition("=")[0], options.option_strings(command))
        raise BadInput(f"found {unknown[0]!r}, which {command.prog} does not take{hint}")
    return parsed


def _dispatch(parsed: argparse.Namespace, scenarios: tuple[Scenario, ...]) -> int:
    match parsed.command:
        case "list":
            width = max(len(scenario.name) for scenario in scenarios)
            for scenario in scenarios:
                print(f"{scenario.name:{width}}  {scenario.summary}")
            sys.stdout.flush()
        case "run":
            return _run(parsed, find_scenario(parsed.scenario, scenarios))
        case "calibrate":
            return _calibrate(parsed)
        case "dataset":
            return _dataset(parsed)
        case "detect":
            return _detect(parsed)
        case "view":
            from weldcell.scenarios import recording  # rerun takes a second to import

            recording.view(recording_of(parsed.run))
        case "snapshot":
            from weldcell.scenarios import snapshot

            for complaint in snapshot.take(
                recording_of(parsed.run), _picture(parsed.out), parsed.frame, tab=parsed.tab
            ):
                print(f"weldcell: warning: {complaint}", file=sys.stderr)
            print(parsed.out)
    return EXIT_DONE


def _run(parsed: argparse.Namespace, scenario: Scenario) -> int:
    from weldcell.scenarios.run import run

    outcome = run(
        scenario,
        config_file=parsed.config,
        seed=None if parsed.seed is None else options.typed(int, parsed.seed),
        given=options.given_fields(parsed),
        place=parsed.out,
        overwrite=parsed.overwrite,
    )
    for reason in outcome.reasons:
        print(f"weldcell: failed: {reason}", file=sys.stderr)
    return EXIT_FAILED if outcome.reasons else EXIT_DONE


def _calibrate(parsed: argparse.Namespace) -> int:
    run = {"tcp": tcp_options.calibrate, "hand-eye": _hand_eye}.get(parsed.kind, board_options.calibrate)
    verdict, reasons = run(parsed)
    for reason in reasons:
        print(f"weldcell: {'failed' if verdict == 'refused' else 'warning'}: {_one_line(reason)}", file=sys.stderr)
    _say(f"{verdict}: {parsed.out / 'result.json'}")
    return EXIT_FAILED if verdict == "refused" else EXIT_DONE


def _hand_eye(parsed: argparse.Namespace) -> tuple[str, tuple[str, ...]]:
    from weldcell.scenarios import calibrate

    return calibrate.hand_eye(
        calibrate.HandEyeRequest(
            target=parsed.target,
            radius_m=None if parsed.radius_mm is None else parsed.radius_mm * 1e-3,
            side=parsed.side,
            poses_file=parsed.poses,
            points_file=parsed.points,
            touches_file=parsed.touches,
            tip_flange=None if parsed.tcp_mm is None else tuple(value * 1e-3 for value in parsed.tcp_mm),
            tip_radius_m=parsed.tip_radius_mm * 1e-3,
            euler=parsed.euler,
        ),
        parsed.out,
        overwrite=parsed.overwrite,
    )


def _dataset(parsed: argparse.Namespace) -> int:
    from rich.console import Console

    from weldcell.scenarios.dataset.job import DatasetRequest, make_dataset
    from weldcell.scenarios.progress import progress_on
    from weldcell.scenarios.settings import resolve

    seed = None if parsed.seed is None else options.typed(int, parsed.seed)
    settings = resolve("dataset", file=parsed.config, seed=seed, options=options.given_fields(parsed))
    request = DatasetRequest(
        settings=settings,
        count=parsed.count,
        place=parsed.out,
        layout=parsed.format,
        workers=len(os.sched_getaffinity(0)) if parsed.workers is None else parsed.workers,
    )
    with progress_on(Console(stderr=True)) as progress:
        found = make_dataset(request, progress, overwrite=parsed.overwrite)
    print(f"{parsed.count} frames {found.value}")
    print(parsed.out)
    return EXIT_DONE


def _detect(parsed: argparse.Namespace) -> int:
    from weldcell.scenarios.detect import DetectRequest, detect

    request = DetectRequest(
        images=tuple(parsed.images), joint=parsed.joint, laser_colour=parsed.laser_colour, along=parsed.along
    )
    reasons = detect(request, parsed.out, overwrite=parsed.overwrite, say=_say)
    for reason in reasons:
        print(f"weldcell: failed: {_one_line(reason)}", file=sys.stderr)
    return EXIT_FAILED if reasons else EXIT_DONE


def _picture(path: Path) -> Path:
    if path.suffix.lower() != ".png":
        raise BadInput(f"--out: found {str(path)!r}, expected a name that ends in .png")
    return path


def _parser(scenarios: Iterable[Scenario]) -> tuple[options.Parser, "argparse._SubParsersAction[options.Parser]"]:
    names = ", ".join(scenario.name for scenario in scenarios)
    parser = options.Parser(prog="weldcell", description=weldcell.__doc__)
    parser.add_argument("--version", action="version", version=f"weldcell {weldcell.__version__}")
    everywhere = options.Parser(add_help=False)
    everywhere.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=options.Parser)

    commands.add_parser("list", parents=[everywhere], help="the scenarios, a line each")

    run = commands.add_parser(
        "run",
        parents=[everywhere],
        help="run a scenario",
        usage="weldcell run SCENARIO [--seed N] [--out DIR] [--config FILE.yaml] [any field of the configuration]",
        description="Runs a scenario. Each field of the configuration is an option; config.yaml holds them all.",
    )
    run.add_argument("scenario", metavar="SCENARIO", help=f"one of {names}")
    run.add_argument("--seed", metavar="N", help="where all randomness of the run comes from (default: 0)")
    run.add_argument("--out", metavar="DIR", type=Path, help="the run's folder (default: runs/SCENARIO-SEED)")
    run.add_argument("--config", metavar="FILE.yaml", type=Path, help="settings, e.g. the config.yaml of another run")
    run.add_argument("--overwrite", action="store_true", help="replace a finished run (default: refuse)")
    options.add_field_options(run)

    _add_calibrate(commands, everywhere)
    _add_dataset(commands, everywhere)
    _add_detect(commands, everywhere)

    view = commands.add_parser(
        "view", parents=[everywhere], help="open a recording in the rerun viewer", description="Opens a recording."
    )
    snapshot = commands.add_parser(
        "snapshot",
        parents=[everywhere],
        help="a picture of a recording, without a screen",
        description="Makes a picture of a recording, without a screen.",
    )
    for command in (view, snapshot):
        command.add_argument("run", metavar="RUN", type=Path, help="a run's folder, or a .rrd file")
    snapshot.add_argument("--out", metavar="PICTURE.png", type=Path, required=True, help="the picture to write")
    snapshot.add_argument("--frame", metavar="K", type=int, help="number of the frame to show (default: the last)")
    snapshot.add_argument("--tab", metavar="NAME", help="the recording's tab to show (default: the first)")
    return parser, commands


def _add_calibrate(commands: "argparse._SubParsersAction[options.Parser]", everywhere: options.Parser) -> None:
    calibrate = commands.add_parser(
        "calibrate", parents=[everywhere], help="the estimators on your own data", description="Calibrates from files."
    )
    kinds = calibrate.add_subparsers(dest="kind", required=True, metavar="KIND", parser_class=options.Parser)
    board_options.add_boards(kinds, everywhere)
    tcp_options.add_tcp(kinds, everywhere)
    hand_eye = kinds.add_parser(
        "hand-eye",
        parents=[everywhere],
        help="where the sensor sits on the flange, from sights of one fixed target",
        description="Where the sensor sits on the flange, from sights of one fixed point or sphere. Some poses must "
        "keep one orientation (5 or more, moved along all axes), the others turn about different axes (5 or more).",
    )
    hand_eye.set_defaults(parser=hand_eye)
    add = hand_eye.add_argument
    add("--target", choices=("point", "sphere"), required=True, help="what the sensor saw")
    add("--radius-mm", metavar="MM", type=float, help="the sphere's radius")
    add("--side", type=int, choices=(-1, 1), help="+1: the sphere's centre lies at y > 0 (default: from the data)")
    add("--poses", metavar="FILE.csv", type=Path, required=True, help="flange in the base, a row a pose")
    add("--points", metavar="FILE.csv", type=Path, required=True, help="points in the sensor's frame, by id")
    add("--touches", metavar="FILE.csv", type=Path, help="flange poses at touches of the sphere (default: none)")
    add("--tcp-mm", metavar=("X", "Y", "Z"), nargs=3, type=float, help="torch tip in the flange, for touches")
    add("--tip-radius-mm", metavar="MM", type=float, default=0.0, help="radius of the tip's rounding (default: 0)")
    add("--euler", metavar="SEQ", help="rotation of rx,ry,rz: XYZ about the moving axes, xyz about the fixed ones")
    add("--out", metavar="DIR", type=Path, required=True, help="where result.json goes")
    add("--overwrite", action="store_true", help="replace a result (default: refuse)")


def _add_dataset(commands: "argparse._SubParsersAction[options.Parser]", everywhere: options.Parser) -> None:
    dataset = commands.add_parser(
        "dataset",
        parents=[everywhere],
        help="labelled pictures of random seams",
        usage="weldcell dataset --count N --out DIR [--seed N] [--workers K] [--format coco|yolo] [any field]",
        description="Makes labelled pictures of random seams, drawn from the ranges of the configuration's section "
        "`dataset`. An interrupted set goes on with the same command.",
    )
    add = dataset.add_argument
    add("--count", metavar="N", type=int, required=True, help="number of pictures")
    add("--out", metavar="DIR", type=Path, required=True, help="the data set's folder")
    add("--seed", metavar="N", help="where all randomness of the set comes from (default: 0)")
    add("--workers", metavar="K", type=int, help="processes; the files don't depend on it (default: one a core)")
    add("--format", choices=("coco", "yolo"), default="coco", help="form of the labels (default: coco)")
    add("--config", metavar="FILE.yaml", type=Path, help="settings, e.g. the config.yaml of another set")
    add("--overwrite", action="store_true", help="replace another data set (default: refuse)")
    options.add_field_options(dataset)


def _add_detect(commands: "argparse._SubParsersAction[options.Parser]", everywhere: options.Parser) -> None:
    detect = commands.add_parser(
        "detect",
        parents=[everywhere],
        help="stripe centre and seam features in your own pictures",
        usage="weldcell detect IMAGE... --joint KIND --out DIR [--laser-colour COLOUR] [--along AXIS]",
        description="Finds laser stripe and joint features in pictures (PNG, JPEG, TIFF, BMP; grey or colour, "
        "8 or 16 bits), in pixels: (0, 0) is the centre of the top-left pixel. Left is left in the picture.",
    )
    add = detect.add_argument
    add("images", metavar="IMAGE", nargs="+", type=Path, help="pictures (after -- if a name starts with a dash)")
    add("--joint", metavar="KIND", required=True, help="kind of joint, e.g. v (a wrong one lists all)")
    add(
        "--laser-colour",
        choices=("red", "green", "blue", "mono", "auto"),
        default="auto",
        help="colour of the laser, for colour pictures (default: auto, the one with the clearest stripe)",
    )
    add(
        "--along",
        choices=("rows", "columns", "auto"),
        default="auto",
        help="what the stripe runs along (default: auto, which follows diagonal ones as well)",
    )
    add("--out", metavar="DIR", type=Path, required=True, help="where stripe.csv, features.csv and overlays go")
    add("--overwrite", action="store_true", help="replace files of an earlier detection (default: refuse)")
