"""``safestage rules``: check, explain, compare and test rule files."""

from __future__ import annotations

import json

import click

from .options import rules_option


@click.group("rules")
def command() -> None:
    """Check, explain, compare and test rule files.

    \b
    Examples:
      safestage rules check mine.toml
      safestage rules show ETS201
      safestage rules signals clearance
    """


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
            loaded = load_rules(specs)
            codes = ", ".join([*loaded.rules, *loaded.costs])
            click.echo(f"sound: {codes or 'no rules'}")
    ctx.exit(2 if found else 0)


@command.command("show")
@click.argument("what", metavar="[CODE|FILE]...", nargs=-1)
@rules_option
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def show(what: tuple[str, ...], rules: tuple[str, ...], as_json: bool) -> None:
    """Explain rules: what they ask, with which values from where, and what a trace must hold.

    CODE is a rule (ETS201), looked for in --rules, or in all built-in files. FILE is a rule file
    or a built-in name, and stands for all rules in it. Without either, the rules are listed.

    \b
    Examples:
      safestage rules show                       codes and titles
      safestage rules show ETS201
      safestage rules show mine.toml
      safestage rules show ETS901 --rules mine.toml --json
    """
    from safestage_eval.report.as_rule import explain_rule, rule_facts
    from safestage_eval.rules.find import find_rules, list_rules

    if not what:
        for code, title, path in list_rules(rules):
            click.echo(f"{code}  {title}  ({path})")
        return
    found = [rule_facts(*item) for item in find_rules(what, rules)]
    if not found:
        click.echo(f"{', '.join(what)}: only definitions, no rules to explain", err=True)
    if as_json:
        click.echo(json.dumps(found, indent=1, ensure_ascii=False))
    else:
        click.echo("\n".join(map(explain_rule, found)), nl=False)


@command.command("signals")
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="The vocabulary as JSON.")
def signals(names: tuple[str, ...], as_json: bool) -> None:
    """List the signals and relations that conditions may ask for.

    For each its arguments, its dimension and units, what it means, and what a trace must hold.

    \b
    Examples:
      safestage rules signals
      safestage rules signals clearance
      safestage rules signals --json
    """
    from safestage_eval.errors import InputError
    from safestage_eval.report.as_rule import explain_vocabulary, vocabulary
    from safestage_eval.rules.names import nearest

    found = vocabulary()
    known = {entry["name"]: entry for entry in found}
    for name in names:
        if name not in known:
            raise InputError(
                name, "no signal or relation has this name.", ", ".join(known), nearest(name, known)
            )
    if names:
        found = [known[name] for name in names]
    if as_json:
        click.echo(json.dumps(found, indent=1, ensure_ascii=False))
        return
    pages = [[entry] for entry in found] if names else [found]
    click.echo("\n".join(map(explain_vocabulary, pages)), nl=False)


@command.command("schema")
def schema() -> None:
    """Print the JSON Schema of rule files, for completion and checks while typing.

    Save it and name it in the first line of a rule file. Editors with the taplo language server
    ("Even Better TOML" in VS Code) then complete keys, explain them and mark mistakes:

    \b
      #:schema ./rules.schema.json

    Or, for all rule files of a project, in .taplo.toml:

    \b
      [[rule]]
      include = ["rules/*.toml"]
      schema.path = "rules.schema.json"

    \b
    Example:
      safestage rules schema > rules.schema.json
    """
    from safestage_eval.rules.schema import schema_text

    click.echo(schema_text(), nl=False)
