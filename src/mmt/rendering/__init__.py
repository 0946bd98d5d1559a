"""Render texture models inside another program, in four calls.

::

    from mmt.rendering import close, open_textures, render, touch

    textures = open_textures(["plastic.npz"], output_hz=2000)
    touch(textures, 0, velocity_x_mm_s=100.0, force_n=1.0)
    vibration_m_s2 = render(textures, 2000)
    close(textures)
"""

from mmt.rendering.calls import Textures, close, open_textures, render, touch

__all__ = ["Textures", "close", "open_textures", "render", "touch"]
