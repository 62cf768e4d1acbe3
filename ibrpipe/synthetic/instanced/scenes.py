"""The generated scenes of copies by name, and their settings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pydantic import Field, field_validator

from ibrpipe.config import StageConfig
from ibrpipe.errors import ConfigError, closest
from ibrpipe.io.assets import read_asset
from ibrpipe.synthetic.instanced.city import city
from ibrpipe.synthetic.instanced.clearing import clearing
from ibrpipe.synthetic.instanced.forest import forest
from ibrpipe.synthetic.instanced.solids import solids
from ibrpipe.synthetic.instanced.trees import SPECIES
from ibrpipe.types import Scene


class InstancedConfig(StageConfig):
    """Size of a generated scene."""

    trees: int = Field(default=1000, ge=1, le=10_000_000, description="forest: number of trees")
    species: tuple[str, ...] = Field(
        default=tuple(SPECIES),
        min_length=1,
        description=f"forest: kinds of trees, mixed at random: {', '.join(SPECIES)}",
    )
    blocks: int = Field(default=4, ge=1, le=1_000_000, description="city: number of blocks of sixteen houses")
    asset: Path | None = Field(
        default=None, description="forest: asset folder, z up, to stand on a lawn in a clearing in the middle"
    )
    asset_height: float = Field(default=3.0, gt=0, le=1000, description="forest: height of the asset in metres")
    seed: int = Field(default=5, ge=0, description="Seed of the layout and of shapes")

    @field_validator("species")
    @classmethod
    def _species_are_known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in SPECIES:
                raise ValueError(f"there is no species {name!r}; {closest(name, SPECIES)}")
        if len(set(names)) < len(names):
            raise ValueError(f"names one species twice: {', '.join(names)}")
        return names


def _forest(config: InstancedConfig) -> Scene:
    wood = forest(config.trees, config.seed, config.species)
    if config.asset is None:
        return wood
    return clearing(wood, read_asset(config.asset), config.asset_height, config.seed)


#: name -> the settings that it has, and what makes it
_SCENES: dict[str, tuple[tuple[str, ...], Callable[[InstancedConfig], Scene]]] = {
    "forest": (("trees", "species", "asset", "asset_height", "seed"), _forest),
    "city": (("blocks", "seed"), lambda config: city(config.blocks, config.seed)),
    "solids": ((), lambda config: solids()),
}


def instanced_names() -> tuple[str, ...]:
    """Names that `make_instanced` knows."""
    return tuple(_SCENES)


def settings_of(name: str) -> tuple[str, ...]:
    """Return the settings that a scene has."""
    return _SCENES[name][0]


def make_instanced(name: str, config: InstancedConfig) -> Scene:
    """Generate a scene by name.

    Raises
    ------
    ConfigError
        No scene has this name.
    """
    if name not in _SCENES:
        raise ConfigError(f"there is no generated scene {name!r}; {closest(name, _SCENES)}")
    return _SCENES[name][1](config)
