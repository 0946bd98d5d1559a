"""The texture player: a page on which a person strokes textures, as in paper B's demonstration.

Abdulali and Jeon, *Data-Driven Rendering of Anisotropic Haptic Textures*, sections 3.3 and 3.4.
The browser renders the models by `mmt-texture.js`; the answers of the study are kept here.
"""
