"""The page: a picture behind orbit controls, and sliders. The only place that loads viser."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.files.errors import InputError
from weft.renderer.image import srgb
from weft.renderer.progressive import Refinement

from .desk import Desk
from .look import Eye, Look, as_toml

if TYPE_CHECKING:
    import viser

ANGLES = (
    ("longitudinal_width_r", "R width (deg)", 0.5, 60.0),
    ("longitudinal_width_tt", "TT width (deg)", 0.5, 60.0),
    ("longitudinal_width_trt", "TRT width (deg)", 0.5, 60.0),
    ("azimuthal_width_tt", "TT around (deg)", 2.0, 300.0),
)
"""Field, label and range of the sliders for widths."""
COLORS = (("color_r", "R color"), ("color_tt", "TT color (dye)"), ("color_trt", "TRT color"))
SIDES = (128, 256, 384, 512, 768, 1024, 2048)


class Browser:
    """Controls that write to a desk, and the picture that is sent back."""

    def __init__(
        self,
        desk: Desk,
        lobes: Mapping[str, FiberScatteringParameters],
        *,
        host: str,
        port: int,
        job_aspect: float,
    ) -> None:
        self.desk, self.lobes, self.job_aspect = desk, lobes, job_aspect
        self.server = _server(host, port)
        self.viewer: viser.ClientHandle | None = None
        look, _ = desk.take()
        self.home = look
        _set_initial_camera(self.server, look.eye)
        self._picture_controls(look)
        self._light_controls()
        for medium, one in lobes.items():
            self._scattering_controls(medium, one)
        self.server.on_client_connect(self._connected)
        self.server.on_client_disconnect(self._disconnected)

    @property
    def address(self) -> str:
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def show(self, picture: np.ndarray, *, finished: bool) -> None:
        """Send a picture, uint8, shape [height, width, 3], to who moved last; lossless when finished."""
        if self.viewer is not None:
            self.viewer.scene.set_background_image(
                picture, format="png" if finished else "jpeg", jpeg_quality=None if finished else 85
            )

    def tell(self, refinement: Refinement, samples: int) -> None:
        """Say how far the picture is."""
        noise = "" if math.isinf(refinement.noise) else f", noise {refinement.noise:.1%}"
        size = f"1/{refinement.scale} size" if refinement.scale > 1 else f"{refinement.samples} of {samples}"
        speed = f"{refinement.paths_per_second / 1e6:.2f} M paths/s"
        self.status.content = f"{size}{noise}, {speed}, {refinement.seconds:.1f} s"

    def stop(self) -> None:
        self.server.stop()

    def _connected(self, client: viser.ClientHandle) -> None:
        self.viewer = client
        client.camera.on_update(lambda camera: self._moved(client, camera))
        self._moved(client, client.camera)
        self.desk.call()

    def _disconnected(self, client: viser.ClientHandle) -> None:
        if self.viewer is client:
            self.viewer = None

    def _moved(self, client: viser.ClientHandle, camera: viser.CameraHandle) -> None:
        if camera.update_timestamp == 0 or not camera.image_width or not camera.image_height:
            return
        self.viewer = client
        eye = Eye(_vector(camera.position), _vector(camera.look_at), _vector(camera.up_direction), camera.fov)
        size = camera.image_width, camera.image_height
        if eye.distance > 0:
            self.desk.change(lambda look: replace(look, eye=eye, size=size))

    def _picture_controls(self, look: Look) -> None:
        gui = self.server.gui
        self.status = gui.add_markdown("starting")
        exposure = gui.add_slider("Exposure (stops)", -8.0, 8.0, 0.1, look.exposure)
        self._on(exposure, lambda look, value: replace(look, exposure=float(value)))
        samples = gui.add_slider("Samples", 1, max(1024, look.samples), 1, look.samples)
        self._on(samples, lambda look, value: replace(look, samples=int(value)))
        sides = tuple(str(side) for side in sorted({*SIDES, look.longest_side}))
        side = gui.add_dropdown("Pixels", sides, initial_value=str(look.longest_side))
        self._on(side, lambda look, value: replace(look, longest_side=int(value)))
        gui.add_button("Back to the job's camera").on_click(lambda event: self._go_home())
        gui.add_button("Download as TOML").on_click(self._download)

    def _light_controls(self) -> None:
        with self.server.gui.add_folder("Light"):
            turn = self.server.gui.add_slider("Turn (deg)", -180.0, 180.0, 1.0, 0.0)
            self._on(turn, lambda look, value: replace(look, light_turn_deg=float(value)))
            follow = self.server.gui.add_checkbox("Turns with the camera", False)
            self._on(follow, lambda look, value: replace(look, lights_follow=bool(value)))

    def _scattering_controls(self, medium: str, lobes: FiberScatteringParameters) -> None:
        gui = self.server.gui
        with gui.add_folder(f"Fibers: {medium}"):
            for name, label in COLORS:
                color = gui.add_rgb(label, eight_bits(getattr(lobes, name)))
                self._on(color, _edit(medium, name, linear_color))
            for name, label, low, high in ANGLES:
                degrees = min(max(round(math.degrees(getattr(lobes, name)), 1), low), high)
                slider = gui.add_slider(label, low, high, 0.1, degrees)
                self._on(slider, _edit(medium, name, math.radians))
            through = gui.add_slider("Light let through (T)", 0.0, 1.0, 0.01, round(lobes.fresnel_tt, 2))
            self._on(through, _edit(medium, "fresnel_tt", float))
            gloss = round(float(np.mean(lobes.fresnel_r)), 3)
            reflected = gui.add_slider("Reflectance (F)", 0.0, 1.0, 0.001, gloss)
            self._on(reflected, _edit(medium, "fresnel_r", lambda value: (float(value),) * 3))

    def _on(self, control: Any, step: Callable[[Look, Any], Look]) -> None:
        """Change the look when a person moves a control."""
        control.on_update(lambda event: self.desk.change(lambda look: step(look, control.value)))

    def _go_home(self) -> None:
        if self.viewer is not None:
            camera, eye = self.viewer.camera, self.home.eye
            camera.up_direction, camera.fov = eye.up, eye.vertical_fov
            camera.position = eye.position
            camera.look_at = eye.target

    def _download(self, event: Any) -> None:
        look, _ = self.desk.take()
        text = as_toml(look, job_aspect=self.job_aspect, every_medium=len(self.lobes) == 1)
        if self.viewer is not None:
            self.viewer.send_file_download("look.toml", text.encode())


def _edit(medium: str, name: str, convert: Callable[[Any], Any]) -> Callable[[Look, Any], Look]:
    return lambda look, value: look.edited(medium, **{name: convert(value)})


def load_viser() -> Any:
    """Raises `InputError` where viser is not installed."""
    try:
        import viser
    except ModuleNotFoundError as error:
        raise InputError(
            f"weft view needs a package that is not installed: {error.name}.", hint="pip install 'weft[view]'"
        ) from error
    return viser


def _server(host: str, port: int) -> viser.ViserServer:
    with redirect_stdout(io.StringIO()):  # its banner
        server = load_viser().ViserServer(host=host, port=port, label="weft", verbose=False)
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, dark_mode=True, control_layout="fixed"
    )
    return server


def _set_initial_camera(server: viser.ViserServer, eye: Eye) -> None:
    server.scene.set_up_direction(eye.up)
    server.initial_camera.position = eye.position
    server.initial_camera.look_at = eye.target
    server.initial_camera.up = eye.up
    server.initial_camera.fov = eye.vertical_fov


def eight_bits(linear: tuple[float, float, float]) -> tuple[int, int, int]:
    """A linear color as a color picker shows it."""
    r, g, b = (int(value) for value in np.rint(srgb(np.array(linear)) * 255))
    return r, g, b


def linear_color(eight: tuple[int, int, int]) -> tuple[float, float, float]:
    """The linear color of a color picker (inverse of the sRGB transfer function)."""
    x = np.array(eight) / 255
    r, g, b = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).tolist()
    return r, g, b


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
