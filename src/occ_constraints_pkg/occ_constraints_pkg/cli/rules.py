# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands on a constraints file: ``occ show``, ``check``, ``score``, ``prune``, ...."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.cli.common import (
    DATA,
    DEFINITIONS,
    JSON,
    NAMESPACE,
    OVERWRITE,
    Seconds,
    help_without_command,
    needed_cost,
    print_json,
    progress_bar,
    read_data,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.completion import rule_ids
from occ_constraints_pkg.cli.judging import BRIDGE, MAX_LAG, TIMEOUT
from occ_constraints_pkg.cli.report import HTML, named_title
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.files import (
    C_HEADER,
    CONSTRAINTS,
    PAGE,
    PICTURE,
    check_outputs,
    write_text,
)
from occ_constraints_pkg.learning.evidence import describe_why, why_document
from occ_constraints_pkg.learning.rules_text import (
    describe_file,
    describe_rules,
    file_document,
)
from occ_constraints_pkg.rules.forecast import WINDOW_SECONDS
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.traffic.rules_text import rule_rows, rules_table
from occ_constraints_pkg.wording import count_of

_FILE = click.argument('constraints', type=click.Path())
_OUTPUT = click.option(
    '-o', '--output', type=click.Path(), help='File to write; default: in place.'
)


@click.command()
@_FILE
@click.option(
    '--why', metavar='RULE', shell_complete=rule_ids, help='Show the evidence for this rule.'
)
@click.option('--traffic', is_flag=True, help='Explain rules for cars in terms of traffic.')
@click.option('--plot', type=click.Path(), help='Draw the rules to this PNG file, too.')
@click.option(
    '--demonstrations',
    metavar='DATA',
    multiple=True,
    type=click.Path(),
    help='With --plot: draw the density of this recording or table; may be repeated.',
)
@DEFINITIONS
@JSON
def show(
    constraints: str,
    why: str | None,
    traffic: bool,
    plot: str | None,
    demonstrations: tuple[str, ...],
    as_json: bool,
) -> None:
    """Print the rules of a constraints file, or the evidence for one.

    \b
    Example: occ show constraints.yaml
             occ show --why R4def0 constraints.yaml
             occ show --plot rules.png --demonstrations bags/drives constraints.yaml
             occ show --traffic us101.yaml
    """
    if why is not None and traffic:
        raise ConfigurationError('got both --why and --traffic; allowed is one of them')
    if demonstrations and plot is None:
        raise ConfigurationError(
            'got --demonstrations without --plot; they are only drawn, allowed is both or neither'
        )
    draw = None
    if plot is not None:
        check_outputs({plot: PICTURE}, [constraints, *demonstrations])
        draw = import_needed('occ show --plot', 'occ_constraints_pkg.learning.rules_picture')
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    rules, space = loaded.rule_set.rules, loaded.rule_set.space
    if draw is not None and plot is not None:
        drawn = read_data(demonstrations, loaded, constraints).values if demonstrations else None
        draw.draw_rules(Path(plot), loaded, drawn)
    if why is not None:
        document = why_document(loaded, why)
        _print(as_json, lambda: document, lambda: describe_why(document))
    elif traffic:
        _print(
            as_json, lambda: {'rules': rule_rows(rules, space)}, lambda: rules_table(rules, space)
        )
    else:
        _print(as_json, lambda: file_document(loaded), lambda: describe_file(loaded))


@click.command()
@click.argument('first', metavar='A', type=click.Path())
@click.argument('second', metavar='B', type=click.Path())
@JSON
def diff(first: str, second: str, as_json: bool) -> int:
    """Compare two constraints files, and prove where verdicts differ.

    Prints for each rule an input that one file flags and the other does not, then the bounds that
    moved and the rules that are new, gone or edited. Exit code 1 unless the verdicts are proven to
    be the same.

    \b
    Example: occ diff constraints.yaml.bak constraints.yaml
    """
    from occ_constraints_pkg.learning.changes import compare_files
    from occ_constraints_pkg.learning.changes_text import (
        comparison_document,
        describe_comparison,
    )
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    result = compare_files(load_constraints(first), load_constraints(second))
    _print(as_json, lambda: comparison_document(result), lambda: describe_comparison(result))
    return 0 if result.is_same else 1


@click.command()
@DATA
@DEFINITIONS
@click.option('-c', '--constraints', required=True, type=click.Path(), help='Constraints file.')
@click.option(
    '--count',
    'counted',
    type=click.Path(),
    help='Write the constraints file with counters of these recordings, for `occ prune`.',
)
@NAMESPACE
@TIMEOUT
@MAX_LAG
@BRIDGE
@click.option('--plot', type=click.Path(), help='Draw the timeline to this PNG file.')
@HTML
@click.option(
    '--warn',
    'horizon',
    metavar='SECONDS',
    type=Seconds(),
    help='Report how early a monitor would have warned, with warnings up to this time ahead.',
)
@click.option(
    '--warning-window',
    default=WINDOW_SECONDS,
    show_default=True,
    type=Seconds(),
    help='With --warn: seconds over which rates of change are estimated.',
)
@OVERWRITE
@JSON
def check(
    paths: tuple[str, ...],
    constraints: str,
    counted: str | None,
    namespace: str,
    timeout: float,
    max_lag: float,
    bridge: float,
    plot: str | None,
    html: str | None,
    horizon: float | None,
    warning_window: float,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Find when recordings or tables violate which rule, by how much.

    Times are seconds since the recording's first message. Exit code 1 when not all is SAFE.

    \b
    Example: occ check bags/drive_7 -c constraints.yaml --plot drive_7.png
             occ check bags/drive_7 -c constraints.yaml --warn 1
    """
    from occ_constraints_pkg.checking.early_warning import warning_record
    from occ_constraints_pkg.checking.early_warning_text import describe_warnings
    from occ_constraints_pkg.checking.timeline_text import check_document, describe_timeline
    from occ_constraints_pkg.rules import RuleCounts
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived

    check_outputs(
        [
            (path, kind)
            for path, kind in ((counted, CONSTRAINTS), (plot, PICTURE), (html, PAGE))
            if path
        ],
        [constraints, *paths],
    )
    draw = plot and import_needed(
        'occ check --plot', 'occ_constraints_pkg.checking.timeline_picture'
    )
    pages = html and import_needed('occ check --html', 'occ_constraints_pkg.report.checked')
    loaded = load_constraints(constraints)
    data = read_data(
        paths,
        loaded,
        constraints,
        max_lag=max_lag,
        namespace=namespace,
        provenance=bool(html),
    )
    rule_set = loaded.rule_set
    if rule_set.problem:
        warn(f'{constraints} enables no rule, so every verdict is UNKNOWN')
    timeline = check_data(data, rule_set, timeout=timeout, bridge=bridge)
    judgement = timeline.judgement
    counts = RuleCounts(rule_set)
    counts.add(judgement)
    if counted:
        derived = loaded.with_rule_set(rule_set.with_counts(counts))
        _report_copy(counted, save_derived(derived, counted, overwrite=overwrite))
    if draw:
        draw.draw_timeline(Path(plot), timeline, rule_set, Path(constraints).name)
    if pages:
        page = pages.constraints_page(
            named_title(paths),
            constraints,
            loaded,
            timeline=timeline,
            bridge=bridge,
            settings={'timeout [s]': timeout, 'bridge [s]': bridge, 'largest lag [s]': max_lag},
        )
        import_needed('occ check --html', 'occ_constraints_pkg.report.page').write_page(page, html)
    record = None
    if horizon is not None:
        with progress_bar('forecasting') as progress:
            record = warning_record(
                timeline,
                rule_set,
                horizon=horizon,
                window=warning_window,
                bridge=bridge,
                progress=progress,
            )
    if as_json:
        print_json(check_document(timeline, rule_set, counts, record))
    else:
        say_lines(describe_timeline(timeline, rule_set))
        if record:
            say_lines(describe_warnings(record))
    return 0 if timeline.is_safe else 1


@click.command()
@_FILE
@DATA
@DEFINITIONS
@click.option('--min-f1', type=click.FloatRange(0.0, 1.0), help='Exit code 1 when F1 is below.')
@JSON
def score(constraints: str, paths: tuple[str, ...], min_f1: float | None, as_json: bool) -> int:
    """Score rules on recordings or tables that carry the true cost.

    For each rule it prints on how many samples the rule is the first true one, on how many it is
    true at all, and in brackets how many of these are truly costly.

    \b
    Example: occ score constraints.yaml bags/drive_7 --min-f1 0.9
    """
    from occ_constraints_pkg.learning.scoring import describe_score, score_document, score_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    data = read_data(paths, loaded, constraints)
    result = score_rules(loaded.rule_set, data.values, needed_cost(data, paths))
    space = loaded.rule_set.space
    _print(as_json, lambda: score_document(result, space), lambda: describe_score(result, space))
    # Without flagged and costly samples there is no F1, which is not enough either.
    return 0 if min_f1 is None or result.overall.f1 >= min_f1 else 1


@click.command()
@_FILE
@click.option(
    '-t',
    '--threshold',
    default=0.001,
    show_default=True,
    help='Disable rules violated in a smaller share of their evaluations.',
)
@_OUTPUT
@click.option(
    '--counts', type=click.Path(), help="Counters of a monitor (its counts_file); default: FILE's."
)
@OVERWRITE
@JSON
def prune(
    constraints: str,
    threshold: float,
    output: str | None,
    counts: str | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Disable rules that were rarely violated.

    The counters in the file come from `occ check --count`, from `occ train`, or from a monitor
    (--counts).

    \b
    Example: occ prune constraints.yaml --threshold 0.001 -o pruned.yaml
    """
    from occ_constraints_pkg.learning.pruning import prune as prune_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived
    from occ_constraints_pkg.rules.persistent_counts import read_counts

    if output is not None:
        check_outputs({output: CONSTRAINTS}, [constraints, *([counts] if counts else [])])
    loaded = load_constraints(constraints)
    rule_set = loaded.rule_set
    if counts is not None:
        rule_set = rule_set.with_counts(read_counts(counts, rule_set))
    result = prune_rules(rule_set, threshold)
    pruned = loaded.with_rule_set(result.rule_set)
    target = output or constraints
    copy = save_derived(pruned, target, overwrite=overwrite, in_place=output is None)
    _report_copy(target, copy)
    if as_json:
        print_json(
            {
                'output': target,
                'pruned': result.pruned,
                # The name is from a time before this project used the words of the field.
                'untried': result.not_evaluated,
                'kept': [result.rule_set.rules[i].id for i in result.rule_set.order],
            }
        )
        return
    say_lines(describe_rules(pruned, counters=True))
    say(f'{count_of(len(result.pruned), "rule")} disabled; written to {target}')


@click.command()
@_FILE
@_OUTPUT
@click.option(
    '--counted', is_flag=True, help='Also rules with counters; those that change begin at 0.'
)
@OVERWRITE
@JSON
def simplify(
    constraints: str, output: str | None, counted: bool, overwrite: bool, as_json: bool
) -> None:
    """Make rules fewer and shorter without changing a verdict.

    Drops what is implied, merges neighbours, removes what other rules contain. Rules that are
    disabled, have a note, or have counters stay as they are. `occ learn` does this by itself; the
    command is for files that were edited or written by hand.

    \b
    Example: occ simplify constraints.yaml -o shorter.yaml
    """
    from occ_constraints_pkg.learning.simplification import (
        describe_simplification,
        simplification_document,
    )
    from occ_constraints_pkg.learning.simplification import simplify as simplify_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived

    if output is not None:
        check_outputs({output: CONSTRAINTS}, [constraints])
    loaded = load_constraints(constraints)
    result = simplify_rules(loaded.rule_set, counted_too=counted)
    simpler = loaded.with_equal_rules(result.rule_set)
    target = output or constraints
    copy = save_derived(simpler, target, overwrite=overwrite, in_place=output is None)
    _report_copy(target, copy)
    if as_json:
        print_json({'output': target, **simplification_document(result)})
        return
    say_lines(
        f'{describe_rules(simpler)}\n\n{describe_simplification(result)}; '
        f'written to {printable(target)}'
    )


def _report_copy(path: str, copy: Path | None) -> None:
    if copy is not None:
        warn(f'{path} was edited; as it was, comments included, it is kept as {copy}')


@click.group(invoke_without_command=True)
@click.pass_context
def export(context: click.Context) -> None:
    """Export rules for programs without this package.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """
    help_without_command(context)


@export.command()
@_FILE
@click.option('-o', '--output', type=click.Path(), help='File to write; default: stdout.')
@click.option('--prefix', default='occ', show_default=True, help='Begins every name in the file.')
def c(constraints: str, output: str | None, prefix: str) -> None:
    """Write the rules as one C99 header with a function PREFIX_judge.

    It gives the same verdict, rule and margin as the monitor.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.rules.export_c import export_c

    if output is not None:
        check_outputs({output: C_HEADER}, [constraints])
    text = export_c(load_constraints(constraints).rule_set, prefix)
    if output is None:
        say_lines(text, nl=False)
        return
    write_text(output, C_HEADER, text)
    say(f'Written to {output}')


def _print(as_json: bool, document: Callable[[], dict[str, Any]], text: Callable[[], str]) -> None:
    """Print a result as JSON or as text, whichever was asked for."""
    if as_json:
        print_json(document())
    else:
        say_lines(text())
