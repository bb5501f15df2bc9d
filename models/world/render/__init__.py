"""How the simulated camera paints: view, textures, sky, ground, objects, lens."""
