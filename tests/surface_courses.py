"""Strokes that leave one surface for another and come back, for tests of several models."""

from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import CourseChange, SurfaceCourse
from mmt.testing.simulation.surfaces.textures import get_surface


def glass_and_sandpaper(there=6000, back=12_000):
    """Return a course from glass to sandpaper, in contact, and back, in the air."""
    changes = [CourseChange(there, 1, in_contact=True), CourseChange(back, 0, in_contact=False)]
    return SurfaceCourse([get_surface("glass"), get_surface("sandpaper")], changes)


def stroked_over(course, duration_s=17.0):
    """Return the frames of a session over a course, and its truth."""
    return simulate_session(Scene(), course, duration_s, 4)
