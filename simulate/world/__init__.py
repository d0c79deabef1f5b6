"""The simulated world: table, arm and objects in MuJoCo, and what is read off it per frame."""
