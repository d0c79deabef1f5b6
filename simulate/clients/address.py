"""The address of a served policy: ``openpi:ws://127.0.0.1:8000?name=pi05&horizon=15``."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlsplit

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from safestage_eval.errors import InputError

if TYPE_CHECKING:
    from .dialect import Dialect

PROTOCOLS = {
    "openpi": ("openpi", "Openpi"),
    "groot": ("groot", "Groot"),
    "dreamzero": ("dreamzero", "Dreamzero"),
    "cosmos3": ("cosmos3", "Cosmos3"),
}
"""Protocol → its file in this folder and its class there."""
NEEDED = ("msgpack", "websockets", "zmq", "PIL")
"""Packages of the extra ``policies``."""


class Common(BaseModel):
    """Options of an address in every protocol."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str | None = Field(None, pattern=r"^[\w.=+-]+$")
    """The policy's name in episodes and tables; the protocol where None."""
    wait: float = Field(10.0, ge=0)
    """s to wait for a server that is not there yet."""
    timeout: float | None = Field(None, gt=0)
    """s to wait for an answer; the protocol's own where None."""


@dataclass(frozen=True)
class Address:
    """A served policy."""

    dialect: Dialect
    url: str
    common: Common

    @property
    def name(self) -> str:
        """The policy's name: two servers of one protocol need a name each."""
        return self.common.name or self.dialect.protocol


def is_address(policy: str) -> bool:
    """Whether a policy's name is an address."""
    kind, _, rest = policy.partition(":")
    return kind in PROTOCOLS and not rest.isidentifier()


def dialect_named(protocol: str) -> type[Dialect]:
    """A protocol's class. Raises InputError for what is none."""
    if protocol not in PROTOCOLS:
        raise InputError(f"protocol {protocol!r}", "no such protocol.", ", ".join(PROTOCOLS))
    missing = [package for package in NEEDED if importlib.util.find_spec(package) is None]
    if missing:
        raise InputError(
            f"protocol {protocol!r}", f"{', '.join(missing)} not installed.",
            fix="pip install 'safestage[policies]'",
        )  # fmt: skip
    module, name = PROTOCOLS[protocol]
    result: type[Dialect] = getattr(importlib.import_module(f"{__package__}.{module}"), name)
    return result


def address_of(policy: str) -> Address:
    """Read an address: PROTOCOL:URL, and options after a question mark.

    Raises InputError that says which part is wrong, and what there is.
    """
    where = f"policy {policy!r}"
    protocol, _, rest = policy.partition(":")
    kind = dialect_named(protocol)
    try:
        parts = urlsplit(rest)
        port = parts.port
    except ValueError as error:
        raise InputError(where, f"{error}.", example(kind)) from None
    if parts.scheme in kind.schemes and parts.hostname:
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        url = f"{parts.scheme}://{host}:{port or kind.port}{parts.path}"
    else:
        raise InputError(where, f"{rest!r} is not where {protocol} is served.", example(kind))
    dialect, common = _options(kind, parts.query, where)
    return Address(dialect, url, common)


def dialect_of(protocol: str) -> Dialect:
    """A protocol with options as in an address: ``openpi?actions=velocity``. Raises InputError."""
    name, _, options = protocol.partition("?")
    return _options(dialect_named(name), options, f"protocol {protocol!r}")[0]


def _options(kind: type[Dialect], query: str, where: str) -> tuple[Dialect, Common]:
    given = dict(parse_qsl(query, keep_blank_values=True))
    options = {key: value for key, value in given.items() if key in Common.model_fields}
    own = {key: value for key, value in given.items() if key not in options}
    try:
        return kind.model_validate(own), Common.model_validate(options)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        names = [field.alias or name for name, field in kind.model_fields.items()]
        raise InputError(where, f"{wrong}.", ", ".join([*names, *Common.model_fields])) from None


def example(kind: type[Dialect]) -> str:
    """Form of a protocol's addresses."""
    return f"{kind.protocol}:{kind.schemes[0]}://HOST:{kind.port}?name=MY_MODEL"
