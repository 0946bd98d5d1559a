"""Tables and parts of sharing and of control, for the leader and for listeners."""

from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import Field

from mmt.scene.table import AddedPart, Flag, PartTable, SecuredTable, ServedTable

CONTROL_VARIABLE: Final = "MMT_CONTROL_TOKEN"
_VISITORS: Final = "mmt_share.commands.visitors_page:visitors_page"


class Sharing(ServedTable):
    """``[sharing]``: the leader lets others feel the model that it builds."""

    port: int = Field(8766, ge=0, le=65_535)
    most: int = Field(200, ge=1, le=10_000)
    store: Path | None = None
    accept: bool = False


class Control(PartTable):
    """``[control]``: a listener that shows a token may be given control of the robot."""

    token_file: Path | None = None
    silence_ms: float = Field(200.0, ge=50, le=5000)


class Operating(PartTable):
    """``[operating]``: this listener asks for control of the leader's robot."""

    gives: ClassVar[tuple[Literal["model", "force"], ...]] = ("force",)

    token_file: Path | None = None


class Listening(SecuredTable):
    """``[listening]``: render the model that another machine's leader shares."""

    gives: ClassVar[tuple[Literal["model", "force"], ...]] = ("model",)

    url: str = "http://127.0.0.1:8766"
    name: str | None = Field(None, max_length=64)
    patience_s: float = Field(10.0, ge=0.5, le=3600)


SHARING: Final = AddedPart(
    "mmt_share.parts.sharing:SharingPart",
    before="control",
    table=Sharing,
    tasks=("sharing",),
    rules="mmt_share.rules:sharing",
    flags=(
        Flag("--share", "Let others feel the surface: share the model.", ("sharing",)),
        Flag(
            "--page",
            "Share the model, and serve a page for visitors.",
            ("sharing",),
            side_service=_VISITORS,
        ),
        Flag(
            "--share",
            "Let others feel the surface: share the model.",
            ("sharing",),
            command="demo",
            side_service=_VISITORS,
        ),
    ),
    foreign=("hub",),
)
CONTROL: Final = AddedPart(
    "mmt_share.parts.control:ControlPart",
    before="metrics",
    table=Control,
    rules="mmt_share.rules:control",
    flags=(
        Flag(
            "--control",
            "Share, and let a listener with the token for it have control.",
            ("sharing", "control"),
        ),
    ),
    secrets=(CONTROL_VARIABLE,),
)
LISTENING: Final = AddedPart(
    "mmt_share.parts.listening:ListeningPart",
    before="metrics",
    table=Listening,
    tasks=("listening",),
    rules="mmt_share.rules:listening",
)
OPERATING: Final = AddedPart(
    "mmt_share.parts.operating:OperatingPart",
    before="playout",
    table=Operating,
    rules="mmt_share.rules:operating",
    secrets=(CONTROL_VARIABLE,),
)
