"""Devices in software that speak the real ones' protocols, to try drivers and scenes on."""
