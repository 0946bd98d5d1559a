"""A pyusb backend with one device on it, whose endpoints are all of the bulk kind."""

import errno
from types import SimpleNamespace
from typing import Any, Final

import usb.backend
import usb.core

_DEVICE: Final = {
    "bLength": 18,
    "bDescriptorType": 1,
    "bcdUSB": 0x200,
    "bDeviceClass": 255,
    "bDeviceSubClass": 0,
    "bDeviceProtocol": 0,
    "bMaxPacketSize0": 64,
    "bcdDevice": 0,
    "iManufacturer": 0,
    "iProduct": 0,
    "iSerialNumber": 0,
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
    "iConfiguration": 0,
    "bmAttributes": 0x80,
    "bMaxPower": 250,
    "extra_descriptors": [],
}
_INTERFACE: Final = {
    "bLength": 9,
    "bDescriptorType": 4,
    "bInterfaceNumber": 0,
    "iInterface": 0,
    "bAlternateSetting": 0,
    "bInterfaceClass": 255,
    "bInterfaceSubClass": 0,
    "bInterfaceProtocol": 0,
    "extra_descriptors": [],
}
_ENDPOINT: Final = {
    "bLength": 7,
    "bDescriptorType": 5,
    "bmAttributes": 2,
    "wMaxPacketSize": 64,
    "bInterval": 0,
    "bRefresh": 0,
    "bSynchAddress": 0,
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
        return SimpleNamespace(**_DEVICE, **self._ids)

    def get_configuration_descriptor(self, _: object, config: int) -> Any:
        """Describe its only configuration."""
        if config:
            raise IndexError(config)
        return SimpleNamespace(**_CONFIGURATION)

    def get_interface_descriptor(self, _: object, intf: int, alt: int, *__: Any) -> Any:
        """Describe its only interface."""
        if intf or alt:
            raise IndexError(alt)
        return SimpleNamespace(**_INTERFACE, bNumEndpoints=len(self._endpoints))

    def get_endpoint_descriptor(self, _: object, ep: int, *__: Any) -> Any:
        """Describe one of its endpoints."""
        return SimpleNamespace(**_ENDPOINT, bEndpointAddress=self._endpoints[ep])

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
