"""A picture of a recording, made without a screen."""

from pathlib import Path

from weldcell.cell.errors import BadInput
from weldcell.scenarios.recording import HeadlessViewer


def take(
    recording: Path,
    picture: Path,
    frame: int | None = None,
    *,
    tab: str | None = None,
    width_px: int = 1920,
    height_px: int = 1080,
    timeout_s: float = 60.0,
) -> list[str]:
    """What the views complained of (nothing, if all is well), after writing the picture (PNG).

    `frame` is a picture's number (the last if None), `tab` a tab's name (the first if None). Raises BadInput for a
    recording, frame or tab that cannot be shown, WeldcellError if the viewer cannot work here.
    """
    unfinished = picture.with_name(f".unfinished-{picture.stem}.png")
    with HeadlessViewer.open(recording, width_px=width_px, height_px=height_px, timeout_s=timeout_s) as viewer:
        first, last = viewer.frames()
        if frame is not None and not first <= frame <= last:
            raise BadInput(f"{recording}: found no frame {frame}, expected {first} to {last}")
        viewer.show(frame=last if frame is None else frame, tab=tab)
        png, complaints = viewer.picture(), viewer.complaints()
    picture.parent.mkdir(parents=True, exist_ok=True)
    try:
        unfinished.write_bytes(png)
        unfinished.replace(picture)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
    return complaints
