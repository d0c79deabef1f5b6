"""``safestage rules``."""

from __future__ import annotations

import json

import click


@click.group("rules")
def command() -> None:
    """Check rule files."""


@command.command("check")
@click.argument("rules", nargs=-1, metavar="[RULES]...")
@click.option("--json", "as_json", is_flag=True, help="Diagnostics as JSON, for editors.")
@click.pass_context
def check(ctx: click.Context, rules: tuple[str, ...], as_json: bool) -> None:
    """Find everything that is wrong with rule files, all at once.

    RULES are files, folders or built-in names; without any, the built-in rules are checked. Each
    problem says where it is, what is allowed and how to mend it. Exit code 2 if there is any.

    \b
    Example:
      safestage rules check my_rules.toml
    """
    from safestage_eval.rules import builtin_names, check_rules, load_rules

    specs = list(rules) or builtin_names()
    found = check_rules(specs)
    if as_json:
        click.echo(json.dumps([d.to_dict() for d in found], indent=1, ensure_ascii=False))
    else:
        for diagnostic in found:
            click.echo(diagnostic.render() + "\n", err=True)
        if found:
            click.echo(f"{len(found)} problem{'s' if len(found) != 1 else ''}", err=True)
        else:
            codes = ", ".join(load_rules(specs).rules)
            click.echo(f"sound: {codes or 'no rules'}")
    ctx.exit(2 if found else 0)
