"""Models of the Penn Haptic Texture Toolkit."""
