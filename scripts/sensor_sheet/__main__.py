"""Makes the sheets of pictures in docs/sensor.md: `.venv/bin/python scripts/sensor_sheet [NAME ...]`."""

import argparse
from pathlib import Path

from PIL import Image
from sheets import SHEETS

_PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
_QUALITY = 85


def main() -> None:
    parser = argparse.ArgumentParser(prog="sensor_sheet", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*SHEETS, []], help="sheets to make (default: all)")
    parser.add_argument("--out", metavar="DIR", type=Path, default=_PICTURES, help="where they go (docs/pictures)")
    parsed = parser.parse_args()
    for name in parsed.names or SHEETS:
        path = parsed.out / f"sensor_{name}.jpg"
        Image.fromarray(SHEETS[name]()).save(path, quality=_QUALITY, optimize=True)
        print(path)


if __name__ == "__main__":
    main()
