"""A finished animation as a GIF and as an MP4; the MP4 needs the extra `video`, which brings an ffmpeg."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.animation import AbstractMovieWriter, Animation, FFMpegWriter
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from tvae.errors import TvaeError
from tvae.files import appearing
from tvae.spaces import IntArray

FRAMES_PER_SECOND = 10
DOTS_PER_INCH = 110
_NUM_COLOURS = 255
_PLAIN_MP4 = (
    *("-f", "mp4", "-pix_fmt", "yuv420p", "-movflags", "+faststart"),
    *("-crf", "20", "-tune", "animation"),
    *("-threads", "1", "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"),
)
"""What every browser plays; one thread and no date nor version, so that equal frames give equal bytes."""


class MissingVideoError(TvaeError):
    """No ffmpeg to write an MP4 with; the message says how to get one."""


def require_video() -> str:
    """The ffmpeg that writes MP4 files: call it early, before hours of work that end in one.

    Raises `MissingVideoError` where the extra `video` is not installed, or has no ffmpeg for this computer.

    >>> try:
    ...     found = require_video()
    ... except MissingVideoError as error:
    ...     found = str(error)
    >>> "ffmpeg" in found
    True
    """
    try:
        import imageio_ffmpeg  # noqa: PLC0415

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise MissingVideoError(f"MP4 files need ffmpeg: pip install 'tvae[video]' ({error})") from error


def save_animation(animation: Animation, path: Path) -> None:
    """Write `path` + `.gif` and `path` + `.mp4`, both or none; equal animations give equal bytes.

    Ten frames a second. The GIF repeats for ever, has one palette for all frames, and shows frames that are
    equal to the one before as one longer frame. The MP4 is H.264 with the pixel format yuv420p; a figure of
    an odd number of pixels loses one.

    Raises `MissingVideoError` where `require_video` does.
    """
    ffmpeg = require_video()
    gif, mp4 = (path.with_name(f"{path.name}.{suffix}") for suffix in ("gif", "mp4"))
    with appearing(gif, overwrite=True) as partial_gif, appearing(mp4, overwrite=True) as partial_mp4:
        camera = _Camera(fps=FRAMES_PER_SECOND)
        animation.save(partial_gif, writer=camera, dpi=DOTS_PER_INCH)
        _write_gif(camera.frames, partial_gif)
        _write_mp4(camera.frames, partial_mp4, ffmpeg)


class _Camera(AbstractMovieWriter):
    """Keeps the frames, so that each is drawn once for both files."""

    def __init__(self, fps: int) -> None:
        super().__init__(fps=fps)
        self.frames: list[Image.Image] = []

    def setup(self, fig: Figure, outfile: str | Path, dpi: float | None = None) -> None:
        super().setup(fig, outfile, dpi)

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        buffer = BytesIO()
        self.fig.savefig(buffer, **{**savefig_kwargs, "format": "rgba", "dpi": self.dpi})
        width, height = (size - size % 2 for size in self.frame_size)
        frame = Image.frombytes("RGBA", self.frame_size, buffer.getvalue()).convert("RGB")
        self.frames.append(frame.crop((0, 0, width, height)))

    def finish(self) -> None:
        """Nothing to do."""


def _write_gif(frames: Sequence[Image.Image], path: Path) -> None:
    palette = _palette(frames)
    first, *others = (_indexed(frame, palette) for frame in frames)
    duration = round(1000 / FRAMES_PER_SECOND)
    first.save(path, format="GIF", save_all=True, append_images=others, duration=duration, loop=0)


def _palette(frames: Sequence[Image.Image]) -> IntArray:
    """(K, 3): the commonest colours of the first, the middle and the last frame."""
    sheet = np.concatenate([np.asarray(frames[index]) for index in (0, len(frames) // 2, -1)])
    colours, counts = np.unique(_codes(sheet), return_counts=True)
    return _channels(colours[np.argsort(-counts, kind="stable")[:_NUM_COLOURS]])


def _indexed(frame: Image.Image, palette: IntArray) -> Image.Image:
    """The frame with each colour replaced by the nearest of the palette (K, 3); white stays white."""
    codes = _codes(np.asarray(frame))
    colours, which = np.unique(codes, return_inverse=True)
    distances = ((_channels(colours)[:, None] - palette) ** 2).sum(-1)
    image = Image.fromarray(distances.argmin(1).astype(np.uint8)[which].reshape(codes.shape))
    image.putpalette(palette.astype(np.uint8).tobytes())
    return image


def _codes(pixels: NDArray[np.uint8]) -> IntArray:
    """One number for each colour (..., 3)."""
    return pixels.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])


def _channels(codes: IntArray) -> IntArray:
    """(N, 3): the colours of `_codes` (N,)."""
    return np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=1)


def _write_mp4(frames: Sequence[Image.Image], path: Path, ffmpeg: str) -> None:
    """The frames as pictures that fill a figure of their size."""
    width, height = frames[0].size
    screen = Figure((width / DOTS_PER_INCH, height / DOTS_PER_INCH), dpi=DOTS_PER_INCH)
    picture = screen.figimage(np.asarray(frames[0]))
    film = FFMpegWriter(fps=FRAMES_PER_SECOND, codec="libx264", bitrate=-1, extra_args=list(_PLAIN_MP4))
    with matplotlib.rc_context({"animation.ffmpeg_path": ffmpeg}), film.saving(screen, str(path), DOTS_PER_INCH):
        for frame in frames:
            picture.set_data(np.asarray(frame))
            film.grab_frame()
