"""Rule files: TOML in, a checked and hashed rule set out. No geometry."""

from .bind_file import BindFile, bind_names, bind_tables, find_bind, load_bind, load_binding
from .diagnostic import Diagnostic, RuleErrors
from .digest import rule_digest
from .episode_binding import Binding, bind_episode
from .files import benchmark_names, builtin_names
from .load import check_rules, load_rules
from .overrides import parse_overrides
from .syntax import GoalDef, Rule, RuleSet

__all__ = [
    "BindFile",
    "Binding",
    "Diagnostic",
    "GoalDef",
    "Rule",
    "RuleErrors",
    "RuleSet",
    "benchmark_names",
    "bind_episode",
    "bind_names",
    "bind_tables",
    "builtin_names",
    "check_rules",
    "find_bind",
    "load_bind",
    "load_binding",
    "load_rules",
    "parse_overrides",
    "rule_digest",
]
