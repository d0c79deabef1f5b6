"""What only cameras see: a room, light, textures and skins, all computed; nothing here collides."""
