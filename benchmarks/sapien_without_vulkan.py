"""Lets ManiSkill run on a machine without Vulkan: what is only looked at is not built. Import it first."""

from __future__ import annotations

from typing import Any

import sapien.render
import sapien.wrapper.actor_builder
import sapien.wrapper.urdf_loader


class Nothing:
    """Stands for a render material."""

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def __setattr__(self, name: str, value: Any) -> None: ...

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: None


Builder: Any = sapien.wrapper.actor_builder.ActorBuilder
for module in (sapien.render, sapien.wrapper.urdf_loader, sapien.wrapper.actor_builder):
    if hasattr(module, "RenderMaterial"):
        module.RenderMaterial = Nothing
for name in dir(Builder):
    if (name.startswith("add_") and name.endswith("visual")) or name == "add_visual_from_file":
        setattr(Builder, name, lambda self, *_, **__: self)
Builder.build_render_component = lambda _: None
