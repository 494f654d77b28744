"""What the surfaces of parts may be."""

from typing import Literal

MaterialName = Literal["matt-white", "mill-scale", "ground-steel", "stainless", "aluminium", "polished"]
TextureName = Literal["none", "brushed", "scratched"]
