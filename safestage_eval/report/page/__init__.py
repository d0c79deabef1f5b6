"""A campaign as one HTML page that opens anywhere: no network, no server, nothing to install."""

from .build import Report, build

__all__ = ["Report", "build"]
