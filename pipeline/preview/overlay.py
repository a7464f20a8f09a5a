"""Text and rectangles on top of a panel, in its pixels from the lower left corner."""

from __future__ import annotations

from typing import Any, Literal

from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from .scene import Color

INK: Color = (30, 30, 30)
Anchor = Literal["left", "center", "right"]


class Rectangle:
    """A filled rectangle."""

    def __init__(self, renderer: Any, color: Color) -> None:
        self._points, cells, shape = vtkPoints(), vtkCellArray(), vtkPolyData()
        self._points.SetNumberOfPoints(4)
        cells.InsertNextCell(4, [0, 1, 2, 3])
        shape.SetPoints(self._points)
        shape.SetPolys(cells)
        mapper, actor = vtkPolyDataMapper2D(), vtkActor2D()
        mapper.SetInputData(shape)
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(*(level / 255 for level in color))
        renderer.AddViewProp(actor)

    def place(self, left: float, bottom: float, right: float, top: float) -> None:
        for i, (x, y) in enumerate(((left, bottom), (right, bottom), (right, top), (left, top))):
            self._points.SetPoint(i, round(x), round(y), 0.0)
        self._points.Modified()


class Text:
    """One line of text."""

    def __init__(self, renderer: Any, font_pixels: int, color: Color, anchor: Anchor, *, bold: bool) -> None:
        self._actor = vtkTextActor()
        style = self._actor.GetTextProperty()
        style.SetFontFamilyToArial()
        style.SetFontSize(font_pixels)
        style.SetColor(*(level / 255 for level in color))
        style.SetBold(bold)
        {
            "left": style.SetJustificationToLeft,
            "center": style.SetJustificationToCentered,
            "right": style.SetJustificationToRight,
        }[anchor]()
        style.SetVerticalJustificationToBottom()
        renderer.AddViewProp(self._actor)

    def place(self, text: str, x: float, y: float) -> None:
        self._actor.SetInput(text)
        self._actor.SetPosition(round(x), round(y))


class Overlay:
    """What lies on top of one panel."""

    def __init__(self, renderer: Any, font_pixels: int) -> None:
        self._renderer = renderer
        self.font_pixels = font_pixels

    def rectangle(self, color: Color = INK) -> Rectangle:
        return Rectangle(self._renderer, color)

    def text(self, text: str, *, color: Color = INK, anchor: Anchor = "left", bold: bool = False) -> Text:
        line = Text(self._renderer, self.font_pixels, color, anchor, bold=bold)
        line.place(text, 0.0, 0.0)
        return line
