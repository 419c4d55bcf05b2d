# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands on a constraints file: ``occ show``, ``check``, ``score``, ``prune``, ``simplify``."""

from __future__ import annotations

from pathlib import Path

import click

from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, TIMEOUT_SECONDS, check_data
from occ_constraints_pkg.cli.common import (
    DATA,
    JSON,
    OVERWRITE,
    Seconds,
    needed_cost,
    number,
    print_json,
    progress_bar,
    read_data,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS
from occ_constraints_pkg.files import CONSTRAINTS, PICTURE, check_outputs
from occ_constraints_pkg.learning.evidence_text import describe_why, why_document
from occ_constraints_pkg.learning.rules_text import describe_promise, describe_rules
from occ_constraints_pkg.rules.forecast import WINDOW_SECONDS
from occ_constraints_pkg.traffic.rules_text import rule_rows, rules_table
from occ_constraints_pkg.wording import count_of


@click.command()
@click.argument('constraints', type=click.Path())
@click.option('--why', metavar='RULE', help='Show which demonstrations this rule rests on.')
@click.option('--traffic', is_flag=True, help='Say what rules for cars mean in traffic.')
@JSON
def show(constraints: str, why: str | None, traffic: bool, as_json: bool) -> None:
    """Print the rules of a constraints file in words, or why one of them is there.

    \b
    Example: occ show constraints.yaml
             occ show --why R4def0 constraints.yaml
             occ show --traffic us101.yaml
    """
    if why is not None and traffic:
        raise ConfigurationError('got both --why and --traffic; allowed is one of them')
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.rules.listing import rules_document

    loaded = load_constraints(constraints)
    rule_set = loaded.rule_set
    if why is not None:
        document = why_document(loaded, why)
        if as_json:
            print_json(document)
        else:
            say_lines(describe_why(document))
        return
    if traffic:
        if as_json:
            print_json({'rules': rule_rows(rule_set.rules, rule_set.space)})
        else:
            say_lines(rules_table(rule_set.rules, rule_set.space))
        return
    if as_json:
        document = rules_document(rule_set)
        for entry, rule in zip(document['rules'], rule_set.rules, strict=True):
            entry.update(evaluated=rule.evaluated, violated=rule.violated)
        calibration = loaded.learner.get('calibration')
        print_json({**document, 'edited': loaded.is_edited, 'calibration': calibration})
        return
    say_lines(describe_rules(loaded, counters=True))
    promise = describe_promise(loaded)
    if promise:
        say('')
        say(promise)


@click.command()
@DATA
@click.option('-c', '--constraints', required=True, type=click.Path(), help='Constraints file.')
@click.option(
    '--count',
    'counted',
    type=click.Path(),
    help='Write the constraints file with counters of these recordings, for `occ prune`.',
)
@click.option(
    '--timeout',
    default=TIMEOUT_SECONDS,
    show_default=True,
    type=Seconds(),
    help='Seconds that a verdict is valid without new input; after that the time is UNKNOWN.',
)
@click.option(
    '--max-lag',
    default=MAX_LAG_SECONDS,
    show_default=True,
    type=Seconds(above_zero=False),
    help='Seconds that messages may come late, by log times and stamps, until the verdict is '
    'UNKNOWN; 0: any.',
)
@click.option(
    '--bridge',
    default=BRIDGE_SECONDS,
    show_default=True,
    type=Seconds(above_zero=False),
    help='Violations of a rule that are at most as many seconds apart count as one.',
)
@click.option('--plot', type=click.Path(), help='Draw the timeline to this PNG file.')
@click.option(
    '--warn',
    'horizon',
    metavar='SECONDS',
    type=Seconds(),
    help='Tell how early a monitor would have warned, if it does within so many seconds.',
)
@click.option(
    '--warning-window',
    default=WINDOW_SECONDS,
    show_default=True,
    type=Seconds(),
    help='For --warn: seconds over which rates of change are looked for.',
)
@OVERWRITE
@JSON
def check(
    paths: tuple[str, ...],
    constraints: str,
    counted: str | None,
    timeout: float,
    max_lag: float,
    bridge: float,
    plot: str | None,
    horizon: float | None,
    warning_window: float,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Judge recordings or tables by a constraints file: when is which rule violated, how far.

    Times are seconds since the recording's first message. Exit code 1 when not all is SAFE.

    \b
    Example: occ check bags/drive_7 -c constraints.yaml --plot drive_7.png
             occ check bags/drive_7 -c constraints.yaml --warn 1
    """
    import numpy as np

    from occ_constraints_pkg.checking.early_warning import warning_record
    from occ_constraints_pkg.checking.early_warning_text import describe_warnings, warnings_document
    from occ_constraints_pkg.checking.timeline_text import describe_timeline, timeline_document
    from occ_constraints_pkg.rules import RuleCounts, Verdict
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived

    check_outputs(
        [(path, kind) for path, kind in ((counted, CONSTRAINTS), (plot, PICTURE)) if path],
        [constraints, *paths],
    )
    draw = plot and import_needed(
        'occ check --plot', 'occ_constraints_pkg.checking.timeline_picture'
    )
    loaded = load_constraints(constraints)
    data = read_data(paths, loaded, constraints, max_lag=max_lag)
    rule_set = loaded.rule_set
    if rule_set.problem:
        warn(f'{constraints} enables no rule, so every verdict is UNKNOWN')
    timeline = check_data(data, rule_set, timeout=timeout, bridge=bridge)
    judgement = timeline.judgement
    counts = RuleCounts(rule_set)
    counts.add(judgement)
    if counted:
        derived = loaded.with_rule_set(rule_set.with_counts(counts))
        save_derived(derived, counted, overwrite=overwrite)
    if draw:
        draw.draw_timeline(Path(plot), timeline, rule_set)
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
        broken = [
            {'id': rule.id, 'text': rule.words(rule_set.space), 'violated': int(violated)}
            for rule, violated in zip(rule_set.rules, counts.violated, strict=True)
            if violated
        ]
        print_json(
            {
                'samples': len(data),
                'shares': {
                    verdict.name: float(np.mean(judgement.verdict == verdict))
                    for verdict in Verdict
                },
                'violated_rules': sorted(broken, key=lambda item: -item['violated']),
                'smallest_margin': number(np.nanmin(judgement.margin))
                if (judgement.verdict != Verdict.UNKNOWN).any()
                else None,
                **timeline_document(timeline, rule_set),
                **({'warnings': warnings_document(record, timeline, rule_set)} if record else {}),
            }
        )
    else:
        say_lines(describe_timeline(timeline, rule_set))
        if record:
            say_lines(describe_warnings(record))
    return 0 if timeline.is_safe else 1


@click.command()
@click.argument('constraints', type=click.Path())
@DATA
@click.option('--min-f1', type=click.FloatRange(0.0, 1.0), help='Exit code 1 when F1 is below.')
@JSON
def score(constraints: str, paths: tuple[str, ...], min_f1: float | None, as_json: bool) -> int:
    """Score rules on recordings or tables that carry the true cost.

    For each rule it prints on how many samples the rule is the first true one, on how many it is
    true at all, and in brackets how many of these are truly costly.

    \b
    Example: occ score constraints.yaml bags/drive_7 --min-f1 0.9
    """
    from occ_constraints_pkg.learning.scoring import score_rules
    from occ_constraints_pkg.learning.scoring_text import describe_score, score_document
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    data = read_data(paths, loaded, constraints)
    result = score_rules(loaded.rule_set, data.values, needed_cost(data, paths))
    if as_json:
        print_json(score_document(result, loaded.rule_set.space))
    else:
        say_lines(describe_score(result, loaded.rule_set.space))
    # Without flagged and costly samples there is no F1, which is not enough either.
    return 0 if min_f1 is None or result.overall.f1 >= min_f1 else 1


@click.command()
@click.argument('constraints', type=click.Path())
@click.option(
    '-t',
    '--threshold',
    default=0.001,
    show_default=True,
    help='Disable rules violated in a smaller share of their evaluations.',
)
@click.option('-o', '--output', type=click.Path(), help='File to write; default: in place.')
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
    """Disable rules that are rarely violated, by the counters in the file.

    The counters come from `occ check --count`, from `occ train`, or from a monitor (--counts).

    \b
    Example: occ prune constraints.yaml --threshold 0.001 -o pruned.yaml
    """
    from occ_constraints_pkg.learning.pruning import prune as prune_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived
    from occ_constraints_pkg.rules.kept_counts import read_counts

    if output is not None:
        check_outputs({output: CONSTRAINTS}, [constraints, *([counts] if counts else [])])
    loaded = load_constraints(constraints)
    rule_set = loaded.rule_set
    if counts is not None:
        rule_set = rule_set.with_counts(read_counts(counts, rule_set))
    result = prune_rules(rule_set, threshold)
    pruned = loaded.with_rule_set(result.rule_set)
    target = output or constraints
    save_derived(pruned, target, overwrite=overwrite, in_place=output is None)
    if as_json:
        print_json(
            {
                'output': target,
                'pruned': result.pruned,
                'untried': result.untried,
                'kept': [result.rule_set.rules[i].id for i in result.rule_set.order],
            }
        )
        return
    say_lines(describe_rules(pruned, counters=True))
    say(f'{count_of(len(result.pruned), "rule")} disabled; written to {target}')


@click.command()
@click.argument('constraints', type=click.Path())
@click.option('-o', '--output', type=click.Path(), help='File to write; default: in place.')
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
    from occ_constraints_pkg.learning.simplification import simplify as simplify_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints, save_derived

    if output is not None:
        check_outputs({output: CONSTRAINTS}, [constraints])
    loaded = load_constraints(constraints)
    result = simplify_rules(loaded.rule_set, counted_too=counted)
    simpler = loaded.with_equal_rules(result.rule_set)
    target = output or constraints
    save_derived(simpler, target, overwrite=overwrite, in_place=output is None)
    if as_json:
        print_json(
            {
                'output': target,
                **dict(zip(('rules_before', 'literals_before'), result.before, strict=True)),
                **dict(zip(('rules', 'literals'), result.after, strict=True)),
                'changed': {name: list(former) for name, former in result.changed.items()},
                'removed': list(result.removed),
                'kept': list(result.kept),
            }
        )
        return
    say_lines(describe_rules(simpler))
    say('')
    for name, former in result.changed.items():
        say(f'{name} stands for {", ".join(former)}')
    if result.removed:
        say(f'needed no more: {", ".join(result.removed)}')
    if result.kept:
        say(f'left alone for their note or counters: {", ".join(result.kept)}')
    say(
        f'{count_of(result.before[0], "rule")} with '
        f'{count_of(result.before[1], "literal")} before, '
        + '{} with {} after; '.format(*result.after)
        + f'written to {target}'
    )
