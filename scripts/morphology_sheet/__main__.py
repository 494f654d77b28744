"""Makes the pictures of P1's image processing in docs/seam_features.md: `.venv/bin/python scripts/morphology_sheet`."""

import argparse
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.scanning import scan
from weldcell.scenarios.seam_tracking import taught_path
from weldcell.scenarios.settings import resolve
from weldcell.scenarios.station import Station
from weldcell.tracking.morphology import SeamPoint, seam_point

_PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
_SEED = 1
SEAMS: Mapping[str, Mapping[str, object]] = {
    "u": {},
    "deep": {"seam.thickness_mm": 35.0, "seam.groove_angle_deg": 8.0},
    "shallow": {"seam.thickness_mm": 12.0, "seam.root_radius_mm": 1.5},
}
"""Settings that differ from those of `u-seam`: grooves of 10, 25 and 2 mm."""
_STEPS = {
    "median": "1. median filter",
    "bright": "2. adaptive threshold",
    "pieces": "3. the stripe's pieces, thickened",
    "dilated": "4. dilated {n} times",
    "eroded": "5. eroded {n} times",
    "difference": "6. less the pieces",
    "seam": "7. the bridge, its centroid",
}
_WINDOW_PX, _ZOOM = (170, 300), 2
_COLUMNS = 4
_CAPTION_PX, _GAP_PX, _TEXT_PX = 26, 6, 15
_PAPER, _INK, _POINT = (24, 24, 26), (225, 225, 225), (255, 80, 170)

Panel = UInt8[np.ndarray, "height width 3"]


def main() -> None:
    parser = argparse.ArgumentParser(prog="morphology_sheet", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*SEAMS, []], help="seams to show (default: all)")
    parser.add_argument("--out", metavar="DIR", type=Path, default=_PICTURES, help="where they go (docs/pictures)")
    parsed = parser.parse_args()
    for name in parsed.names or SEAMS:
        path = parsed.out / f"morphology_{name}.png"
        picture, found = processed(SEAMS[name])
        Image.fromarray(sheet(picture, found)).save(path, optimize=True)
        print(path, found.point_px.round(2), found.reason)


def processed(options: Mapping[str, object]) -> tuple[UInt8[np.ndarray, "height width"], SeamPoint]:
    """A picture in the middle of such a seam, and what morphology makes of it."""
    settings = resolve("u-seam", seed=_SEED, options={**options, "seam.frames": 8, "recording.enabled": False})
    config = settings.config
    with (
        Recording(Path("unused.rrd"), config.recording, title="") as recording,
        Station(config, _SEED, recording, Progress()) as station,
    ):
        station.place_plate()
        sights = list(scan(station, taught_path(station), "seam"))
    picture = sights[len(sights) // 2].shot.image
    assert picture is not None
    return picture, seam_point(picture, along=config.sensor.stripe_along)


def sheet(picture: UInt8[np.ndarray, "height width"], found: SeamPoint) -> Panel:
    """All steps about the seam point, magnified without smoothing; the point on the first and the last."""
    captions = {name: text.format(n=found.parameters.dilations) for name, text in _STEPS.items()}
    panels = [_panel(picture, found, "the camera's picture, seam point", marked=True)]
    panels += [
        _panel(getattr(found.steps, name), found, caption, marked=name == "seam") for name, caption in captions.items()
    ]
    rows = [_joined(panels[k : k + _COLUMNS], 1) for k in range(0, len(panels), _COLUMNS)]
    edge = 2 * _GAP_PX
    return cv2.copyMakeBorder(_joined(rows, 0), edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=_PAPER)


def _panel(picture: UInt8[np.ndarray, "height width"], found: SeamPoint, caption: str, *, marked: bool) -> Panel:
    middle = found.point_px if found.valid else np.array(picture.shape[::-1]) / 2
    first = np.clip(np.rint(middle - np.array(_WINDOW_PX) / 2), 0, np.array(picture.shape[::-1]) - _WINDOW_PX)
    u, v = first.astype(int)
    cut = picture[v : v + _WINDOW_PX[1], u : u + _WINDOW_PX[0]]
    panel = cv2.resize(np.repeat(cut[..., None], 3, axis=2), None, fx=_ZOOM, fy=_ZOOM, interpolation=cv2.INTER_NEAREST)
    if marked and found.valid:
        _mark(panel, (found.point_px - first + 0.5) * _ZOOM - 0.5)
    heading = Image.new("RGB", (panel.shape[1], _CAPTION_PX), _PAPER)
    font = ImageFont.load_default(_TEXT_PX)
    ImageDraw.Draw(heading).text((2, _CAPTION_PX / 2), caption, fill=_INK, font=font, anchor="lm")
    return np.vstack([np.asarray(heading), panel])


def _mark(panel: Panel, point: Float[np.ndarray, "2"]) -> None:
    """A cross, open in the middle."""
    for step in (np.array([14.0, 0.0]), np.array([0.0, 14.0])):
        for side in (-1, 1):
            ends = np.rint(np.stack([point + side * step / 3, point + side * step])).astype(int)
            cv2.line(panel, ends[0].tolist(), ends[1].tolist(), _POINT, 2, cv2.LINE_AA)


def _joined(panels: list[Panel], axis: int) -> Panel:
    shape = list(panels[0].shape)
    shape[axis] = _GAP_PX
    gap = np.broadcast_to(np.array(_PAPER, np.uint8), shape)
    return np.concatenate([piece for panel in panels for piece in (gap, panel)][1:], axis=axis)


if __name__ == "__main__":
    main()
