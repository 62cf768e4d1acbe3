"""Cells of the table of hard cases: one case, one setting, its figures and limits. `hard_file` stores them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ibrpipe.config import Document
from ibrpipe.engine.machine import Machine

Status = Literal["pass", "fail", "refused", "not applicable"]


class CaseFacts(Document):
    """One hard case."""

    name: str = Field(description="Name, unique")
    group: int = Field(ge=1, le=9, description="Number of its group")
    what: str = Field(description="What is hard about it")


class SettingFacts(Document):
    """One renderer with options."""

    label: str = Field(description="Name in the table, unique")
    renderer: str = Field(description="Name in the registry")
    options: dict[str, str | int | float | bool] = Field(
        description="Options of the renderer that differ from defaults"
    )
    first_layer: bool = Field(description="Only the first sample of each texel is shown, and compared")


class Figures(Document):
    """Errors of one frame against the exact answer."""

    pixels: int = Field(description="Pixels of the frame")
    hits: int = Field(description="Pixels at which the exact answer is a surface")
    doubtful: int = Field(description="Pixels whose hit moves when the surface is moved by 1e-6 texels")
    lost: int = Field(description="Pixels that show nothing and should show a surface")
    extra: int = Field(description="Pixels that show a surface and should show nothing")
    astray: int = Field(description="Pixels whose hit is more than a texel away along the ray")
    gross: int = Field(description="Wrong pixels that stay wrong when the exact picture may be shifted by a texel")
    nan: int = Field(description="Pixels with NaN in any output")
    texels: float | None = Field(description="Largest distance from the exact hit along the ray, texels")
    texels_p99: float | None = Field(description="99th percentile of the same")
    shift: float | None = Field(description="Largest distance from where a shown texel belongs, pixels")
    shift_p99: float | None = Field(description="99th percentile of the same")
    off: float | None = Field(description="Largest distance in depth from the surface at the shown texel, texels")
    off_p99: float | None = Field(description="99th percentile of the same")
    codes: float | None = Field(description="Largest error of colour, 8-bit codes of linear light")
    codes_p99: float | None = Field(description="99th percentile of the same")
    rmse: float | None = Field(description="Root mean square distance along the ray, texels, over right hits")
    meant: float | None = Field(description="Largest distance in depth from the surface before it was stored, texels")
    meant_p99: float | None = Field(description="99th percentile of the same")
    coverage: float | None = Field(
        None, description="Of scenes of copies: shown area over the exact one, less 1, or less 0 where nothing is seen"
    )
    leak: float | None = Field(
        None, description="Of scenes of copies: what is seen through pixels that are covered with all neighbours, mean"
    )


class Limits(Document):
    """What the frame may show at most; null = no limit."""

    texels: float | None = Field(description="For the largest distance along the ray, rounding of depth included")
    texels_p99: float | None = Field(description="For its 99th percentile")
    shift_p99: float | None = Field(description="For the 99th percentile in pixels")
    wrong: float | None = Field(description="For the share of pixels lost, extra or astray")
    gross: float | None = Field(description="For the share of pixels that are wrong by more than a texel's shift")
    codes_p99: float | None = Field(description="For the 99th percentile of colour")
    meant: float | None = Field(description="For the distance from the surface before it was stored")
    coverage: float | None = Field(None, description="For the error of the covered area, either way")
    leak: float | None = Field(None, description="For what is seen through covered pixels")
    reason: str = Field(description="Why the limits are these")


class Cell(Document):
    """One case, one setting, one type of the arrays given, one storage of depth; with one thread and with all."""

    case: str = Field(description="Name of the case")
    setting: str = Field(description="Label of the setting; 'load' = making the texture itself")
    input: Literal["float64", "float32"] = Field(description="Type of all arrays that the renderer was given")
    bits: int = Field(description="Bits of stored depth: 8, 16, or 32 for float32")
    status: Status = Field(description="pass, fail, refused (a clear error, permitted), or not applicable")
    failures: list[str] = Field(description="What is beyond its limit, in words")
    message: str = Field(description="The error met, or why the case does not apply")
    same_bytes: bool | None = Field(description="One thread and all threads gave the same bytes")
    depth_bytes: int | None = Field(description="Bytes of stored depth")
    figures: Figures | None = Field(description="Errors; null where nothing was rendered")
    limits: Limits | None = Field(description="Limits that the figures were held to")


class HardCasesModel(Document):
    """All cells, and what they were measured on."""

    machine: Machine = Field(description="Processor, threads, versions")
    threads: list[int] = Field(description="Numbers of threads with which every cell was rendered")
    cases: list[CaseFacts] = Field(description="Cases, group by group")
    settings: list[SettingFacts] = Field(description="Settings, in the order of the table's columns")
    cells: list[Cell] = Field(description="All cells, by case")
    seconds: float = Field(ge=0, description="Time of the whole run, s")

    @property
    def failing(self) -> list[Cell]:
        """Cells beyond a limit."""
        return [cell for cell in self.cells if cell.status == "fail"]
