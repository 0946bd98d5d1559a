"""Serial ports in sentences: why one cannot be opened, and what to do."""

import errno

from serial.tools import list_ports


def explain_refusal(error: Exception) -> str:
    """Return why a port cannot be opened, with what to do."""
    code = getattr(error, "errno", None)
    if code == errno.EACCES:
        return (
            "no permission. On Linux add yourself to the group that owns it (dialout or uucp: "
            "sudo usermod -aG dialout $USER) and log in again"
        )
    if code in {errno.ENOENT, errno.ENXIO, errno.ENODEV}:
        ports = [str(info.device) for info in list_ports.comports()]
        return f"there is none; plug the board in. There are: {', '.join(ports) or 'no ports'}"
    if code in {errno.EBUSY, errno.EAGAIN}:
        return "another program has it open; close that one (a serial monitor, another session)"
    return str(error)
