"""What each sheet shows."""

from collections.abc import Callable
from dataclasses import replace
from typing import get_args

from panels import Panel, captioned, labelled, part, sheet, whole
from shots import FRAME, PLATE, Shot, take

from weldcell.cell.configuration import SENSOR_PRESETS, Disturbance, MaterialName, SensorConfig, SensorPreset

_SIZE = (560, 420)
_SMALL = (400, 300)
_MARGIN_PX = 20
_IN_LIGHT = replace(FRAME, ambient_grey=25.0, place_ratio=0.49)
_STEEP = (
    replace(PLATE, material="stainless", groove_angle_deg=35.0, groove_depth_mm=25.0, root_gap_mm=2.0),
    replace(FRAME, yaw_deg=30.0, roll_deg=12.0),
)
"""A groove whose root a wall hides."""
_KEY = "labels: stripe centre green (seen) or orange (hidden), stripe mask green, ghost mask blue, red ticks: no light"


def materials() -> Panel:
    """Each material on the same V-groove, and one that hides and shades."""
    rows = []
    for name in get_args(MaterialName):
        texture = "none" if name == "matt-white" else "brushed"
        shot = take(replace(PLATE, material=name, texture=texture))
        rows.append(_row(shot, f"{name}, {shot.exposure_ms:.1f} ms"))
    shot = take(*_STEEP)
    rows.append(_row(shot, f"stainless, steep groove with a gap, sensor turned by 30°, {shot.exposure_ms:.1f} ms"))
    return sheet(f"Materials (preset p2), exposed for the stripe on the plate\n{_KEY}", rows)


def textures() -> Panel:
    """Patterns of the surface, in the cell's light and in the laser's."""
    rows = []
    for texture, spots in (("brushed", 0), ("scratched", 0), ("none", 6), ("scratched", 6)):
        plate = replace(PLATE, texture=texture, tack_spots=spots)
        shot = take(plate, _IN_LIGHT)
        what = f"texture {texture}" + (f", {spots} tack spots" if spots else "")
        rows.append(_row(shot, f"ground-steel, {what}, {shot.exposure_ms:.1f} ms"))
    return sheet(f"Textures (preset p2, more light in the cell)\n{_KEY}", rows)


def disturbances() -> Panel:
    """Each disturbance on one plate."""
    plate = replace(PLATE, texture="brushed")
    scripts: tuple[tuple[Disturbance, ...], ...] = (
        (),
        (Disturbance(kind="arc", strength=0.1),),
        (Disturbance(kind="arc"),),
        (Disturbance(kind="spatter", strength=4.0),),
        (Disturbance(kind="arc", strength=0.1), Disturbance(kind="fume", strength=5.0)),
        (Disturbance(kind="arc", strength=0.3), Disturbance(kind="spatter"), Disturbance(kind="fume")),
        (Disturbance(kind="stripe-lost", strength=0.8),),
        (Disturbance(kind="sensor-knocked", strength=3.0),),
        (Disturbance(kind="stuck-exposure"),),
    )
    rows = []
    for script in scripts:
        shot = take(plate, replace(FRAME, disturbances=script), exposure_ms=3.0)
        rows.append(_row(shot, " + ".join(f"{one.kind} x {one.strength:g}" for one in script) or "undisturbed"))
    return sheet(f"Disturbances (preset p2, ground steel, 3 ms, strengths as given)\n{_KEY}", rows)


def presets() -> Panel:
    """Each preset on the same plate."""
    rows = []
    for preset in get_args(SensorPreset):
        sensor = SENSOR_PRESETS[preset]
        height_mm = 5.0 - sensor.below_tip_mm
        shot = take(replace(PLATE, texture="brushed"), replace(FRAME, height_mm=height_mm), sensor)
        what = f"{preset}: {sensor.width_px} x {sensor.height_px}, stripe along {sensor.stripe_along}"
        rows.append(_row(shot, f"{what}, {shot.exposure_ms:.1f} ms"))
    return sheet(f"Presets, ground steel\n{_KEY}", rows)


def summary() -> Panel:
    """A few of all, for the README."""
    script = (Disturbance(kind="arc", strength=0.3), Disturbance(kind="spatter", strength=3.0))
    plain = {
        "mill scale, scratched": take(replace(PLATE, material="mill-scale", texture="scratched"), _IN_LIGHT),
        "arc and spatter": take(replace(PLATE, texture="brushed"), replace(FRAME, disturbances=script)),
        "tack spots": take(replace(PLATE, tack_spots=6), _IN_LIGHT),
    }
    with_labels = {
        "polished: ghosts (blue) and stripe (green)": take(replace(PLATE, material="polished")),
        "steep groove: hidden stripe (orange)": take(*_STEEP),
        "preset p1: stripe along columns": take(frame=replace(FRAME, height_mm=5.0), sensor=SENSOR_PRESETS["p1"]),
    }
    rows = [captioned(whole(shot.picture, _SMALL), caption) for caption, shot in plain.items()]
    labels = [
        captioned(labelled(shot, shot.middle_px, _SMALL, _zoom(shot, _SMALL)), caption)
        for caption, shot in with_labels.items()
    ]
    return sheet("", [rows, labels])


def close_ups() -> Panel:
    """The chip's and the lens's doings, pixel by pixel."""
    rows = [_labels(), _speckle(), _saturation(), _defocus(), _motion(), _bits()]
    return sheet("Close-ups (each pixel magnified, nothing smoothed)", rows)


SHEETS: dict[str, Callable[[], Panel]] = {
    "materials": materials,
    "textures": textures,
    "disturbances": disturbances,
    "presets": presets,
    "close_ups": close_ups,
    "summary": summary,
}
"""Sheets by the ends of their files' names."""


def _row(shot: Shot, caption: str) -> list[Panel]:
    """The whole picture, its groove, and the groove with labels."""
    zoom = _zoom(shot, _SIZE)
    return [
        captioned(whole(shot.picture, _SIZE), caption),
        captioned(part(shot.picture, shot.middle_px, _SIZE, zoom), f"x{zoom}"),
        captioned(labelled(shot, shot.middle_px, _SIZE, zoom), f"x{zoom}, dark parts lifted, with labels"),
    ]


def _zoom(shot: Shot, size: tuple[int, int]) -> int:
    """How much the seam's features can be magnified in a panel."""
    return max(
        1, *sorted(length // (wanted + _MARGIN_PX) for length, wanted in zip(size, shot.size_px, strict=True))[:1]
    )


def _beside_groove(shot: Shot) -> tuple[float, float]:
    """A place of the stripe on the plate."""
    u = shot.truth.features.pixels[0, 0] + 60.0
    stripe = shot.truth.stripe
    seen = stripe.pixels[stripe.seen]
    nearest = seen[abs(seen[:, 0] - u).argmin()]
    return float(nearest[0]), float(nearest[1])


def _labels() -> list[Panel]:
    shot = take(replace(PLATE, material="matt-white"))
    names, pixels = shot.truth.features.names, shot.truth.features.pixels
    return [
        captioned(labelled(shot, (float(u), float(v)), (536, 300), 10), f"labels x10: {name}, dark parts lifted")
        for name, (u, v) in zip(names, pixels, strict=True)
    ]


def _speckle() -> list[Panel]:
    panels = []
    for material in ("matt-white", "ground-steel"):
        for f_number in (4.0, 16.0):
            shot = take(replace(PLATE, material=material), sensor=SensorConfig(f_number=f_number))
            caption = f"speckle: {material}, f/{f_number:g}"
            panels.append(captioned(part(shot.picture, _beside_groove(shot), (400, 200), 8), caption))
    return panels


def _saturation() -> list[Panel]:
    panels = []
    for exposure_ms, blooming in ((4.0, 0.0), (40.0, 0.0), (40.0, 0.3), (40.0, 0.8)):
        sensor = SensorConfig(blooming_ratio=blooming)
        shot = take(frame=replace(FRAME, ambient_grey=1.5), sensor=sensor, exposure_ms=exposure_ms)
        caption = f"{exposure_ms:g} ms, blooming ratio {blooming:g}"
        panels.append(captioned(part(shot.picture, shot.truth.features.pixels[0], (400, 300), 4), caption))
    return panels


def _defocus() -> list[Panel]:
    panels = []
    for tilt_deg in ((0.0, 0.0), SENSOR_PRESETS["profiler"].tilt_deg):
        for nearer_mm in (0.0, 30.0):
            sensor = replace(SENSOR_PRESETS["profiler"], tilt_deg=tilt_deg, f_number=4.0)
            shot = take(replace(PLATE, material="matt-white"), replace(FRAME, height_mm=-nearer_mm), sensor)
            lens = "lens tilted" if any(tilt_deg) else "lens not tilted"
            caption = f"profiler, f/4, {lens}, {nearer_mm:g} mm nearer"
            panels.append(captioned(part(shot.picture, _beside_groove(shot), (400, 200), 8), caption))
    return panels


def _motion() -> list[Panel]:
    panels = []
    for blurred, speed_mm_s in ((False, 20.0), (True, 20.0), (True, 100.0)):
        sensor = SensorConfig(motion_blur=blurred)
        frame = replace(FRAME, ambient_grey=40.0)
        shot = take(replace(PLATE, texture="scratched"), frame, sensor, exposure_ms=5.0, speed_mm_s=speed_mm_s)
        u, v = shot.truth.features.pixels[0]
        caption = f"motion blur: {speed_mm_s:g} mm/s, 5 ms" if blurred else "no motion blur, 5 ms"
        panels.append(captioned(part(shot.picture, (u + 150, v + 40), (536, 300), 2), caption))
    return panels


def _bits() -> list[Panel]:
    panels = []
    for bits, read_noise_grey in ((8, 0.5), (8, 0.1), (12, 0.1)):
        sensor = SensorConfig(bits=bits, read_noise_grey=read_noise_grey)
        plate, frame = replace(PLATE, material="mill-scale"), replace(FRAME, ambient_grey=4.0)
        shot = take(plate, frame, sensor, exposure_ms=2.0)
        white = 255 if bits == 8 else 4095
        bright = (shot.picture.clip(0, white / 20) * (20 * 255 / white)).astype("uint8")
        caption = f"{bits} bits, read noise {read_noise_grey:g} of 255, 20 times brighter"
        panels.append(captioned(part(bright, shot.truth.features.pixels[1], (536, 300), 4), caption))
    return panels
