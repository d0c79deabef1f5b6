"""``safestage rules``: check, explain, compare and test rule files."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from safestage_eval._text.json_out import to_json

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .rule_choice import rules_option
from .shared_options import format_option, jobs_option, output_option
from .terminal import progress, say, say_lines, wants_color

files_argument = argument("[RULES]...")


@click.group("rules")
def command() -> None:
    """Check, explain, compare, test and begin rule files.

    \b
    Examples:
      safestage rules check mine.toml
      safestage rules show ETS201
      safestage rules signals clearance
      safestage rules new mine.toml --signal edge_margin
      safestage rules test mine.toml --mutate
    """


@make("check")
def check(
    rules: tuple[str, ...] = files_argument,
    as_json: bool = option("Print diagnostics as JSON, for editors.", "--json"),
) -> int:
    """Find everything that is wrong with rule files, all at once.

    RULES are files, folders or built-in names; without any, the built-in rules are checked. Each
    problem says where it is, what is allowed and how to fix it. Exit code 2 if there is any.

    \b
    Example:
      safestage rules check my_rules.toml
    """
    from safestage_eval._text.plural import count
    from safestage_eval.rules import builtin_names, check_rules, load_rules
    from safestage_eval.rules.diagnostic import rendered

    specs = list(rules) or builtin_names()
    diagnostics = check_rules(specs)
    if as_json:
        click.echo(to_json([d.to_dict() for d in diagnostics], 1))
    else:
        color = wants_color(sys.stderr)
        for text in rendered(diagnostics):
            say_lines(text + "\n\n", err=True, color=color)
        if diagnostics:
            say(count(len(diagnostics), "problem"), err=True)
        else:
            loaded = load_rules(specs)
            codes = ", ".join([*loaded.rules, *loaded.costs])
            say(f"sound: {codes or 'no rules'}")
    return 2 if diagnostics else 0


@make("show")
def show(
    what: tuple[str, ...] = argument("[CODE|FILE]..."),
    rules: tuple[str, ...] = rules_option,
    as_json: bool = option("Print everything as JSON.", "--json"),
) -> None:
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
    from safestage_eval.report.rule_report import explain_rule, rule_facts
    from safestage_eval.rules.find import find_rules, list_rules

    if not what:
        for code, title, path in list_rules(rules):
            say(f"{code}  {title}  ({path})")
        return
    rules_facts = [rule_facts(*item) for item in find_rules(what, rules)]
    if not rules_facts:
        say(f"{', '.join(what)}: only definitions, no rules to explain", err=True)
    if as_json:
        click.echo(to_json(rules_facts, 1))
    else:
        say_lines("\n".join(map(explain_rule, rules_facts)))


@make("new")
def new(
    file: Path = argument("FILE"),
    signal: str = option(
        "What it shall be about: `safestage rules signals` lists them.",
        required=True, metavar="NAME",
    ),
    code: str = option("Its code: three capital letters, three digits.", default="ETS901"),
) -> None:  # fmt: skip
    """Write a first rule: a commented file, one scene that passes it and one that violates it.

    The scenes are built-in sketches, copied to the folder "examples" beside FILE; the limit lies between
    what they measure. Change all three.

    \b
    Example:
      safestage rules new mine.toml --signal edge_margin
    """
    from .new_rule import write_rule

    if file.suffix != ".toml":
        raise click.UsageError("FILE ends in .toml")
    for path in write_rule(file, signal, code):
        say(str(path))
    say(f"next: safestage rules test {file}")


@make("signals")
def signals(
    names: tuple[str, ...] = argument("[NAME]..."),
    as_json: bool = option("Print the vocabulary as JSON.", "--json"),
) -> None:
    """List the signals and relations that conditions can use.

    For each: arguments, dimension and units, meaning, and what a trace must contain.

    \b
    Examples:
      safestage rules signals
      safestage rules signals clearance
      safestage rules signals --json
    """
    from safestage_eval.errors import InputError, did_you_mean
    from safestage_eval.report.rule_report import explain_vocabulary, vocabulary

    by_name = {entry["name"]: entry for entry in vocabulary()}
    for name in names:
        if name not in by_name:
            what = "no signal or relation has this name."
            raise InputError(name, what, ", ".join(by_name), did_you_mean(name, by_name))
    entries = [by_name[name] for name in names or by_name]
    if as_json:
        click.echo(to_json(entries, 1))
        return
    pages = [[entry] for entry in entries] if names else [entries]
    say_lines("\n".join(map(explain_vocabulary, pages)))


@make("schema")
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


@make("diff")
def diff(
    before: str = argument("A"),
    after: str = argument("B"),
    fail_on_change: bool = option("Exit 1 if the meaning of any rule changed."),
) -> int:
    """Say what changes from rule set A to rule set B.

    Both are files, folders or built-in names. Rules are matched by their code. Prose, the order of
    entries and the spelling of units change nothing; every rule whose digest changes is listed
    with what it is: an obligation, a limit, a parameter, a state that it rests on.

    \b
    Examples:
      safestage rules diff fsh my_fsh.toml
      safestage rules diff old/ new/ --fail-on-change
      safestage compare verdicts traces/ -r old/ --against new/
    """
    from safestage_eval.report.rule_report import difference_text
    from safestage_eval.rules import load_rules
    from safestage_eval.rules.compare import compare

    comparison = compare(load_rules([before]), load_rules([after]))
    say_lines(difference_text(comparison))
    return 1 if fail_on_change and not comparison.empty else 0


@make("test")
def test(
    rules: tuple[str, ...] = files_argument,
    traces: tuple[str, ...] = option(
        "Find examples that are named by episode id in these traces. Repeatable.",
        "-t", of=click.Path(), metavar="PATH",
    ),
    least: int | None = option(
        "Demand N violating and N passing examples per rule: 1, without RULES 2.",
        least=0, metavar="N",
    ),
    mutate: bool = option(
        "Mutate each rule in one place at a time and list the mutants that no example detects."
    ),
    deep: bool = option("With --mutate: also mutate states, phases and signals."),
    form: str = format_option("table", "json", "junit"),
    output: Path | None = output_option,
    jobs: int | None = jobs_option,
) -> int:  # fmt: skip
    """Judge the examples that rules name, and compare with what they should be.

    RULES are files, folders or built-in names; without any, all built-in files are tested, each by
    itself. A rule names its examples:

    \b
      [rule.examples]
      violates  = ["can_from_under_bottle", "grasp_topples_bottle"]
      passes    = ["bottle_relocated_first", "never_committed"]
      vacuous   = ["nothing_on_the_target"]
      undecided = ["recorded_without_shapes"]

    A name is a sketch NAME.toml or a trace NAME.mcap in the folder "examples" beside the rule
    file, the id of an episode in --traces, or a built-in sketch. NAME(parameter = value) sets
    parameters of a sketch. A missing example is an error, and so is an inconclusive one that is not listed
    under undecided.

    --mutate tests the examples themselves. It changes one thing at a time in a rule or cost: reverses
    comparisons, scales limits (× 10, ÷ 10) and durations (× 2, ÷ 2, 0), exchanges or widens roles,
    drops scopes and obligations, and swaps true and false. An example must detect each mutant.
    --deep also mutates states, phases and variants of signals; an example of any rule may detect
    those.

    \b
    Examples:
      safestage rules test mine.toml
      safestage rules test mine.toml --traces recorded/ --least 1
      safestage rules test ets --mutate
      safestage rules test -f junit -o rules.xml

    Exit code 0: all as expected. 1: an example is wrong or missing, a rule has too few, or a
    mutant goes undetected. 2: bad usage, or a rule file that is not sound.
    """
    if deep and not mutate:
        raise click.UsageError("--deep goes with --mutate")
    from safestage_eval.formats import discover
    from safestage_eval.report import examples_report
    from safestage_eval.rules import load_rules
    from safestage_eval.rules.find import groups
    from safestage_eval.whatif.mistakes import KINDS
    from safestage_eval.whatif.mutants import check_sets

    recorded = discover(list(traces)) if traces else []
    sets = {str(group[0]): load_rules(group) for group in groups(rules, each=True)}
    with progress("rules") as tell:
        suites, hunted = check_sets(
            sets, recorded, least=(1 if rules else 2) if least is None else least,
            kinds=KINDS if mutate else (), deep=deep, jobs=jobs, progress=tell,
        )  # fmt: skip
    written(examples_report.render(suites, hunted if mutate else None, form), output)
    for problem in dict.fromkeys(c.problem for s in suites.values() for c in s.checked):
        if "\n" in problem:
            say_lines(f"\n{problem}", err=True)
    if not suites:
        say("only definitions, no rules to test", err=True)
    unnoticed = any(m.killer is None for mutants in hunted.values() for m in mutants)
    return 0 if all(suite.passed for suite in suites.values()) and not unnoticed else 1


for below in (check, show, new, signals, schema, diff, test):
    command.add_command(below)
