"""Rules for scenes with tables of sharing or control."""

from mmt.scene.scene import Rules, SceneTables
from mmt_share.tables import Listening, Sharing


def sharing(scene: SceneTables) -> Rules:
    """Return the rules of ``[sharing]``."""
    return [
        (
            scene.texture is None and not _saved(scene),
            "[sharing] has no model to share: add [texture], or [rendering] with a saved model",
        ),
    ]


def listening(scene: SceneTables) -> Rules:
    """Return the rules of ``[listening]``."""
    return [
        (
            scene.rendering is None,
            "[listening] renders a shared model: add [rendering] and [actuator]",
        ),
        (
            scene.link is not None or _saved(scene),
            "[listening] takes its model from another leader: leave out [link], [texture] and "
            "'model' of [rendering]",
        ),
        (
            not scene.commands,
            "[listening] is felt by a hand: add [hand] or [handle]",
        ),
    ]


def control(scene: SceneTables) -> Rules:
    """Return the rules of ``[control]``."""
    feedback = scene.force_feedback
    return [
        (
            scene.table(Sharing) is None or scene.link is None or not scene.commands,
            "[control] hands a robot from the leader's hand to a listener: add [sharing], [link], "
            "and [hand] or [handle]",
        ),
        (
            feedback is not None and feedback.method == "passive",
            "[control] lets several hands move the robot, and the passive method accounts for the "
            'energy of one: set method of [force_feedback] to "model" or "streamed"',
        ),
    ]


def operating(scene: SceneTables) -> Rules:
    """Return the rules of ``[operating]``."""
    feedback = scene.force_feedback
    return [
        (
            scene.table(Listening) is None,
            "[operating] asks the leader that is listened to: add [listening]",
        ),
        (
            feedback is not None and feedback.method != "model",
            "[operating] renders its force from the leader's model of the contact: set method of "
            '[force_feedback] to "model", or leave [force_feedback] out',
        ),
    ]


def _saved(scene: SceneTables) -> bool:
    return scene.rendering is not None and scene.rendering.model is not None
