"""How annotations are checked while tests run (pytest's option --jaxtyping-packages names this)."""

from beartype import BeartypeConf, beartype

# An int is taken for a float, as by every type checker.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
