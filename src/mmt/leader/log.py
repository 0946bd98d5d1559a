"""What a run notes of itself, for its parts and its summary."""

import uuid
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mmt.core.process import ProcessMeter
from mmt.core.ticking import TimeHistogram

if TYPE_CHECKING:
    from mmt.leader.surface_log import SurfaceLog
    from mmt.texture.library.identification import Choice
    from mmt.texture.online.work import ModelUpdate


@dataclass
class RunLog:
    """What is noted while the leader runs."""

    session_id: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    meter: ProcessMeter = field(default_factory=ProcessMeter)
    update: "ModelUpdate | None" = None
    update_seconds: list[float] = field(default_factory=list)
    switches: list[dict[str, Any]] = field(default_factory=list)
    late_while_modelling: TimeHistogram = field(default_factory=TimeHistogram)
    start_s: float | None = None
    stop_s: float | None = None
    warm: "Choice | None" = None
    """The known texture that was rendered before the local model."""
    ready_s: float | None = None
    surfaces: "SurfaceLog | None" = None
    """Which surface the tool was on, where surfaces are told apart."""
