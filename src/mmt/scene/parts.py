"""Which of a scene's parts concern which service."""

from typing import Final

from mmt.scene import Scene

SERVICES_OF_PART: Final[dict[str, tuple[str, ...]]] = {
    "link": ("leader", "follower"),
    "network": ("leader", "follower"),
    "simulated": ("follower",),
    "replay": ("follower",),
    "devices": ("follower",),
    "hand": ("leader",),
    "handle": ("leader",),
    "texture": ("leader",),
    "rendering": ("leader",),
    "playout": ("leader",),
    "actuator": ("leader",),
    "force_feedback": ("leader",),
    "recording": ("leader",),
    "metrics": ("leader", "follower"),
    "monitor": ("leader",),
}
"""Every table of a scene but ``[session]``, which is no part."""


def parts_of(scene: Scene, service: str) -> dict[str, bool]:
    """Return the parts that concern "leader" or "follower", and whether they run."""
    return {name: runs for name, runs in scene.parts().items() if service in _services(scene, name)}


def _services(scene: Scene, name: str) -> tuple[str, ...]:
    """Return the services that a table concerns; some methods have a part on either side."""
    feedback = scene.force_feedback
    if name == "force_feedback" and feedback is not None and feedback.method != "streamed":
        return ("leader", "follower")
    return SERVICES_OF_PART[name]
