"""What the configs of all networks have in common. Each network's own config stands beside it, in its file.

Fields are `files.settings.setting`: default, meaning, range. A config says everything that determines a network.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.files.settings import check_settings, setting


@dataclass(frozen=True)
class ModelConfig:
    """The name of the network's family, and how many SH bands it predicts. Raises ValueError out of range."""

    name: str
    bands: int = setting(3, "SH bands B of the transfer; B*B coefficients", least=1, most=MAX_BANDS)

    def __post_init__(self) -> None:
        check_settings(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain values by field name."""
        return asdict(self)


def check_heads(heads: int, widths: Sequence[int]) -> None:
    """Raise ValueError where channels cannot be split evenly into attention heads."""
    for width in widths:
        if width % heads:
            raise ValueError(f"{width} channels cannot be split into {heads} heads: use a multiple")
