"""The modelling's stages in a thread, where a test looks into the modeller."""

from mmt.leader.modelling.process import ModellingProcess
from mmt.leader.modelling.stages import Stages


class InThread(ModellingProcess):
    """Calls the stages in this process."""

    _stages: Stages

    def _start(self):
        self._stages = Stages(*self._setup)

    def _exchange(self, message):
        name, arguments, named = message
        return getattr(self._stages, name)(*arguments, **named)
