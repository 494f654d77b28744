"""`weldcell detect`: stripe centre and seam features in the user's own pictures, in pixels."""

import csv
import io
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from weldcell.cell.errors import BadInput
from weldcell.scenarios.atomic_file import write_bytes, write_text
from weldcell.scenarios.detect_overlay import overlay_png
from weldcell.scenarios.picture_file import check_picture, read_picture
from weldcell.scenarios.run_folder import lock_folder, make_folders, remove_empty
from weldcell.tracking.joint import JOINT_KINDS
from weldcell.tracking.picture_joint import PictureJoint, joint_in_picture
from weldcell.tracking.picture_stripe import LaserColour, PictureStripe, stripes_in_picture
from weldcell.tracking.stripe import Along

STRIPE_FILE = "stripe.csv"
FEATURES_FILE = "features.csv"
_OVERLAY_END = "-overlay.png"
_LONGEST_STEM = 56  # letters; a file's name has at most 255 bytes
_UNFINISHED = ".unfinished"


@dataclass(frozen=True, kw_only=True)
class DetectRequest:
    """What the command line asks for."""

    images: tuple[Path, ...]
    joint: str
    laser_colour: LaserColour | Literal["auto"] = "auto"
    along: Along | Literal["auto"] = "auto"

    def __post_init__(self) -> None:
        if self.joint not in JOINT_KINDS:
            raise BadInput(f"--joint: found {self.joint!r}, expected one of {', '.join(sorted(JOINT_KINDS))}")


@dataclass(frozen=True, kw_only=True)
class Detection:
    """What was found in one picture."""

    image: Path
    seen: PictureStripe
    joint: PictureJoint

    @property
    def summary(self) -> str:
        """One line for the terminal."""
        count = len(self.seen.stripe.u_px)
        if not count:
            return f"{self.image}: {self.joint.reason}"
        sigma_px = np.median(self.seen.stripe.sigma_px)
        stripe = f"{self.image}: stripe of {count} points (sigma {sigma_px:.2f} px)"
        if not self.joint.valid:
            return f"{stripe}; not found: {self.joint.reason}"
        places = (
            f"{name} {u:.2f} {v:.2f}" for name, (u, v) in zip(self.joint.names, self.joint.points_px, strict=True)
        )
        return f"{stripe}; {', '.join(places)}"


def detect(
    request: DetectRequest, place: Path, *, overwrite: bool = False, say: Callable[[str], None] = print
) -> tuple[str, ...]:
    """Why nothing was found in any picture, if so; writes stripe.csv, features.csv and an overlay for each picture.

    Nothing is written unless every picture could be read.
    """
    overlays = overlay_names(request.images)
    for image in request.images:
        check_picture(image)
    with _all_or_nothing(place, (*overlays, STRIPE_FILE, FEATURES_FILE), overwrite) as unfinished:
        found = []
        for image, overlay in zip(request.images, overlays, strict=True):
            picture = read_picture(image)
            found.append(_detection(image, picture, request))
            write_bytes(unfinished / overlay, overlay_png(picture, found[-1].seen.stripe, found[-1].joint))
            say(found[-1].summary)
        write_text(unfinished / STRIPE_FILE, _table(("image", "u_px", "v_px", "sigma_px"), _stripe_rows(found)))
        header = ("image", "feature", "u_px", "v_px", "valid", "reason")
        write_text(unfinished / FEATURES_FILE, _table(header, _feature_rows(found)))
    if any(len(one.seen.stripe.u_px) for one in found):
        return ()
    return (f"no stripe was found in any of {len(found)} pictures, the last one: {found[-1].joint.reason}",)


def overlay_names(images: Sequence[Path]) -> list[str]:
    """A name for each picture's overlay, all different (also where upper and lower case are one)."""
    names: list[str] = []
    taken: set[str] = set()
    for image in images:
        stem = image.stem[:_LONGEST_STEM]
        count, name = 1, f"{stem}{_OVERLAY_END}"
        while name.casefold() in taken:
            count += 1
            name = f"{stem}-{count}{_OVERLAY_END}"
        taken.add(name.casefold())
        names.append(name)
    return names


def _detection(image: Path, picture: np.ndarray, request: DetectRequest) -> Detection:
    """The first way of following the stripe that shows the joint; the one that shows the most stripe if none does."""
    ways = stripes_in_picture(picture, colour=request.laser_colour, along=request.along)
    tried = [
        Detection(
            image=image, seen=way, joint=joint_in_picture(way.stripe, request.joint, direction_rad=way.direction_rad)
        )
        for way in ways
    ]
    return next((one for one in tried if one.joint.valid), tried[0])


def _stripe_rows(found: Sequence[Detection]) -> Iterator[tuple[str, ...]]:
    for one in found:
        stripe = one.seen.stripe
        for u, v, sigma in zip(stripe.u_px, stripe.v_px, stripe.sigma_px, strict=True):
            yield _printable(one.image), f"{u:.4f}", f"{v:.4f}", f"{sigma:.4f}"


def _feature_rows(found: Sequence[Detection]) -> Iterator[tuple[str, ...]]:
    for one in found:
        for name, (u, v) in zip(one.joint.names, one.joint.points_px, strict=True):
            place = (f"{u:.4f}", f"{v:.4f}", "true", "") if one.joint.valid else ("", "", "false", one.joint.reason)
            yield _printable(one.image), name, *place


def _table(header: Sequence[str], rows: Iterator[tuple[str, ...]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def _printable(path: Path) -> str:
    """The path as text, also where its bytes are not."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


@contextmanager
def _all_or_nothing(place: Path, names: Sequence[str], overwrite: bool) -> Iterator[Path]:
    """A folder to write these files into; they move to `place` if the block ends well, the tables last."""
    made = make_folders(place)
    try:
        lock = lock_folder(place)
        try:
            taken = [name for name in names if (place / name).exists()]
            if taken and not overwrite:
                raise BadInput(f"{place}: found {taken[0]!r} there, expected a free place (--overwrite replaces it)")
            unfinished = place / _UNFINISHED
            shutil.rmtree(unfinished, ignore_errors=True)  # of a run that was killed
            unfinished.mkdir()
            try:
                yield unfinished
                for name in names:
                    (unfinished / name).replace(place / name)
            finally:
                shutil.rmtree(unfinished, ignore_errors=True)
        finally:
            os.close(lock)
    except BaseException:
        remove_empty(made)
        raise
