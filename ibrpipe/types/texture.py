"""Textures as assets hold them: layers, and any number of ways in which their colour changes with the view."""

from __future__ import annotations

from dataclasses import dataclass

from ibrpipe.types.textures import LayeredDepthImage
from ibrpipe.types.view_dependence import SpiralResiduals, ViewDependence, check_components, kinds_of


@dataclass(frozen=True, eq=False)
class Texture:
    """A layered depth image and, where the scene needs it, its view dependence.

    Attributes
    ----------
    layers : LayeredDepthImage
        Shape, and the colour that does not depend on the view.
    components : tuple of ViewDependence
        At most one of each kind; added to the view-independent colour in this order.

    Raises
    ------
    ShapeError, ValueRangeError
        A component is no view dependence, or two are of one kind.
    """

    layers: LayeredDepthImage
    components: tuple[ViewDependence, ...] = ()

    def __repr__(self) -> str:
        """Return size, samples and kinds of view dependence."""
        return f"{type(self).__name__}({self.layers.size_in_words}, view dependence: {kinds_of(self.components)})"

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", check_components(self.components))

    def component(self, kind: str) -> ViewDependence | None:
        """Return the component of a kind; None = there is none."""
        return next((component for component in self.components if component.kind == kind), None)

    @property
    def residuals(self) -> SpiralResiduals | None:
        """The spiral's residuals; None = there are none."""
        found = self.component(SpiralResiduals.kind)
        return found if isinstance(found, SpiralResiduals) else None


class SpiralTexture(Texture):
    """A texture whose view dependence, if it has any, is a spiral's residuals (gong-yang)."""

    def __init__(self, layers: LayeredDepthImage, residuals: SpiralResiduals | None = None) -> None:
        super().__init__(layers, () if residuals is None else (residuals,))
