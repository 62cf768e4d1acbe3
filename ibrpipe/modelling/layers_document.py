"""What ``layers.json`` holds."""

from __future__ import annotations

from pydantic import Field

from ibrpipe.config import Document, Share


class LayersFigures(Document):
    """Figures of one texture's layered depth image."""

    name: str = Field(description="Name of the texture")
    width: int = Field(ge=1, description="Texels along u")
    height: int = Field(ge=1, description="Texels along v")
    samples: int = Field(ge=0, description="Depth samples in all layers")
    most_layers: int = Field(ge=0, description="Samples of the fullest texel")
    covered_texels: Share = Field(description="Share of the texels with a sample")
    seen_share: Share = Field(description="Share of the samples that a photo sees")
    filled_share: Share = Field(0.0, description="Share of the samples that took the colour of seen ones beside them")
    depth_range: tuple[float, float] | None = Field(description="Nearest and farthest depth, scene units; null = empty")
    bytes: int = Field(ge=0, description="Size of layers.exr")


class Layers(Document):
    """``layers/layers.json``."""

    textures: list[LayersFigures] = Field(description="All textures, in the order of the plan")
    training_psnr: list[float] = Field(
        description="PSNR of diffuse colours on the training photos, before every round of sharpening and at last, dB"
    )
