"""A pyusb backend with one device on it, whose endpoints are all of the bulk kind."""

import errno
from types import SimpleNamespace
from typing import Any, Final

import usb.backend
import usb.core


class _Descriptor(SimpleNamespace):
    """A descriptor of USB; a field that is not given is 0."""

    def __getattr__(self, name: str) -> int:
        return 0


_DEVICE: Final = {
    "bLength": 18,
    "bDescriptorType": 1,
    "bcdUSB": 0x200,
    "bDeviceClass": 255,
    "bMaxPacketSize0": 64,
    "bNumConfigurations": 1,
    "address": 5,
    "bus": 1,
    "port_number": 1,
    "port_numbers": (1,),
    "speed": 3,
}
_CONFIGURATION: Final = {
    "bLength": 9,
    "bDescriptorType": 2,
    "wTotalLength": 39,
    "bNumInterfaces": 1,
    "bConfigurationValue": 1,
    "bmAttributes": 0x80,
    "bMaxPower": 250,
    "extra_descriptors": [],
}
_INTERFACE: Final = {
    "bLength": 9,
    "bDescriptorType": 4,
    "bInterfaceClass": 255,
    "extra_descriptors": [],
}
_ENDPOINT: Final = {
    "bLength": 7,
    "bDescriptorType": 5,
    "bmAttributes": 2,
    "wMaxPacketSize": 64,
    "extra_descriptors": [],
}


class UsbHandle:
    """Handle of a program that has the device open."""

    def __init__(self) -> None:
        self.valid = True
        """False once the device is unplugged, even when it is plugged in again."""


class OneDeviceBackend(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """A `backend` for pyusb; a subclass transfers the bytes.

    Parameters
    ----------
    vendor, product
        Vendor and product number of the device.
    endpoints
        Addresses of the endpoints.
    """

    def __init__(self, vendor: int, product: int, endpoints: tuple[int, ...]) -> None:
        super().__init__()
        self._ids = {"idVendor": vendor, "idProduct": product}
        self._endpoints = endpoints
        self._plugged = True
        self._permitted = True
        self._handles: list[UsbHandle] = []
        self._claimed_by: UsbHandle | None = None

    def unplug(self) -> None:
        """Take the device away while it is open."""
        self._plugged = False
        for handle in self._handles:
            handle.valid = False
        self._handles.clear()
        self._claimed_by = None

    def plug(self) -> None:
        """Bring it back."""
        self._plugged = True

    def forbid(self, *, forbidden: bool = True) -> None:
        """Refuse to open the device, as without a udev rule."""
        self._permitted = not forbidden

    def kill_program(self) -> None:
        """Act as if the program with the device had died: the device goes on, free for another."""
        self._claimed_by = None

    def enumerate_devices(self) -> list[object]:
        """Return the device if it is plugged in."""
        return [self] if self._plugged else []

    def get_device_descriptor(self, *_: Any) -> Any:
        """Describe the device."""
        return _Descriptor(**_DEVICE, **self._ids)

    def get_configuration_descriptor(self, _: object, config: int) -> Any:
        """Describe its only configuration."""
        if config:
            raise IndexError(config)
        return _Descriptor(**_CONFIGURATION)

    def get_interface_descriptor(self, _: object, intf: int, alt: int, *__: Any) -> Any:
        """Describe its only interface."""
        if intf or alt:
            raise IndexError(alt)
        return _Descriptor(**_INTERFACE, bNumEndpoints=len(self._endpoints))

    def get_endpoint_descriptor(self, _: object, ep: int, *__: Any) -> Any:
        """Describe one of its endpoints."""
        return _Descriptor(**_ENDPOINT, bEndpointAddress=self._endpoints[ep])

    def open_device(self, dev: object) -> UsbHandle:  # noqa: ARG002 - there is one
        """Open it."""
        if not self._permitted:
            raise usb.core.USBError("Access denied", errno=errno.EACCES)
        if not self._plugged:
            raise _gone()
        handle = UsbHandle()
        self._handles.append(handle)
        return handle

    def close_device(self, dev_handle: UsbHandle) -> None:
        """Close it."""
        self.release_interface(dev_handle, 0)
        dev_handle.valid = False

    def get_configuration(self, dev_handle: UsbHandle) -> int:
        """Return the active configuration."""
        self.check(dev_handle)
        return 1

    def claim_interface(self, dev_handle: UsbHandle, intf: int) -> None:  # noqa: ARG002
        """Reserve the device for one program."""
        self.check(dev_handle)
        if self._claimed_by not in {None, dev_handle}:
            raise usb.core.USBError("Resource busy", errno=errno.EBUSY)
        self._claimed_by = dev_handle

    def release_interface(self, dev_handle: UsbHandle, intf: int) -> None:  # noqa: ARG002
        """Release the device."""
        if self._claimed_by is dev_handle:
            self._claimed_by = None

    def check(self, dev_handle: UsbHandle) -> None:
        """Raise libusb's error if the device is gone."""
        if not dev_handle.valid:
            raise _gone()


def _gone() -> usb.core.USBError:
    return usb.core.USBError("No such device", errno=errno.ENODEV)
