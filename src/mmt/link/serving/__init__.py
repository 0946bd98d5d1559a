"""Serve HTTP and Socket.IO on one port, open to strangers only narrowly."""
