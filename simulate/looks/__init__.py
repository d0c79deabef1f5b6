"""Visual-only scenery: room, lights, procedural textures and skins. Nothing here collides."""
