"""Turn reports of a Franka arm or its library into sentences that say what to do."""

from typing import Final

from mmt.core.errors import short_message


class ArmProblem(Exception):  # noqa: N818 - a state of the arm, as a sentence without its name
    """The arm cannot be used in its present state."""


_USER_STOP: Final = "its user stop is pressed: see that nobody is in its reach, then release it"
_REFLEX: Final = (
    "it has stopped by a reflex: see what it has touched; it is recovered when it is connected "
    "again, and takes commands from where it then is"
)

OF_MODE: Final = {
    "Other": "it is not ready: unlock its joints and activate FCI in Desk, the robot's web page",
    "Guiding": "it is guided by hand: let go of the buttons at its wrist",
    "Reflex": _REFLEX,
    "UserStopped": _USER_STOP,
}
"""Name of the robot's mode -> why the arm takes no commands."""

_BY_TEXT: Final = (
    ("user stop", _USER_STOP),
    ("safety function", "a safety function is active: switch it off in Desk, or end its cause"),
    (
        "communication_constraints",
        "it has stopped because commands came too late: use a kernel with PREEMPT_RT, a direct "
        "cable and 'realtime = \"enforce\"', and end what loads this machine",
    ),
    (
        "cartesian_reflex",
        "it has stopped because the force at its tip was beyond 'collision_force_n': see what it "
        "has touched, and press less",
    ),
    (
        "joint_reflex",
        "it has stopped because a joint's torque was beyond 'collision_torque_nm': see what it "
        "has touched",
    ),
    (
        "position_limits_violation",
        "it has stopped at the end of its reach: move it back by hand, and keep commands inside "
        "by 'workspace_mm' of [devices]",
    ),
    ("velocity_violation", "it has stopped because it was too fast: lower 'speed_limit_mm_s'"),
    ("manual error recovery", "it must be recovered by hand: follow what Desk shows"),
    ("reflex", _REFLEX),
    (
        "incompatible library version",
        "robot and library speak different versions: install the wheel of franky-control for "
        "your robot's version (timschneider42.github.io/franky, Installation)",
    ),
    (
        "realtime capabilities",
        "this machine's kernel has no PREEMPT_RT: install one, or set 'realtime = \"ignore\"' "
        "for trials and a simulator",
    ),
    (
        "scheduling",
        "real-time scheduling is not permitted: allow rtprio 99 to your user in "
        "/etc/security/limits.conf, or set 'realtime = \"ignore\"' for trials and a simulator",
    ),
    (
        "refused",
        "it takes no connection: check 'host', unlock its joints and activate FCI in Desk, and "
        "end other programs that control it",
    ),
    ("host not found", "there is no machine of that name: check 'host'"),
    ("singular", "it cannot start from where it stands: bend its elbow and wrist by hand"),
)
"""Words in the library's messages and their meaning; specific words before general ones."""

_UNREACHABLE: Final = "it does not answer: check its power and its cable"


def explain(error: Exception) -> str:
    """Return what is wrong with the arm, from an exception of the library or of ours."""
    text = str(error)
    if isinstance(error, ArmProblem):
        return text
    lowered = text.lower()
    meaning = next((means for word, means in _BY_TEXT if word in lowered), None)
    of_network = type(error).__name__ == "NetworkException" or "Net Exception" in text
    if meaning is None and of_network:  # some have no class of their own
        meaning = _UNREACHABLE
    message = short_message(text.removeprefix("libfranka: "))
    return f"the library reports: {message}" if meaning is None else f"{meaning} ({message})"


def is_of_arm(error: Exception) -> bool:
    """Return whether an exception is about the arm, and not a bug in the driver."""
    of_library = type(error).__module__.partition(".")[0] == "franky"
    return of_library or isinstance(error, ArmProblem | RuntimeError)
