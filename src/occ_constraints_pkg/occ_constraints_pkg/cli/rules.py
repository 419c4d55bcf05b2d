# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands on a constraints file: ``occ show``, ``check``, ``score``, ``prune`` and ``export``."""

from __future__ import annotations

import click

from occ_constraints_pkg.cli.common import DATA, JSON, number, print_json, read_data, warn
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.report.rules import describe_rules


@click.command()
@click.argument('constraints', type=click.Path())
@JSON
def show(constraints: str, as_json: bool) -> None:
    """Print the rules of a constraints file in words.

    \b
    Example: occ show constraints.yaml
    """
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    rule_set = loaded.rule_set
    if as_json:
        rules = [
            {
                'id': rule.id,
                'text': rule.words(rule_set.space),
                'formula': rule.formula(rule_set.space),
                'enabled': rule.enabled,
                'note': rule.note,
                'evaluated': rule.evaluated,
                'violated': rule.violated,
            }
            for rule in rule_set.rules
        ]
        print_json({'rule_set': rule_set.fingerprint, 'edited': loaded.is_edited, 'rules': rules})
        return
    click.echo(describe_rules(loaded, counters=True))


@click.command()
@DATA
@click.option('-c', '--constraints', required=True, type=click.Path(), help='Constraints file.')
@click.option(
    '--count',
    'counted',
    type=click.Path(),
    help='Write the constraints file with counters of these recordings, for `occ prune`.',
)
@JSON
def check(paths: tuple[str, ...], constraints: str, counted: str | None, as_json: bool) -> int:
    """Judge recordings or tables by a constraints file; exit code 1 when a sample is not SAFE.

    \b
    Example: occ check bags/drive_7 -c constraints.yaml
    """
    import numpy as np

    from occ_constraints_pkg.rules import RuleCounts, Verdict
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    data = read_data(paths, loaded, constraints)
    rule_set = loaded.rule_set
    if not len(rule_set.order):
        warn(f'{constraints} enables no rule, so nothing is a violation')
    judgement = rule_set.judge(data.values)
    counts = RuleCounts(rule_set)
    counts.add(judgement)
    if counted:
        loaded.with_rule_set(rule_set.with_counts(counts)).save(counted)
    shares = {verdict.name: float(np.mean(judgement.verdict == verdict)) for verdict in Verdict}
    broken = [
        {'id': rule.id, 'text': rule.words(rule_set.space), 'violated': int(violated)}
        for rule, violated in zip(rule_set.rules, counts.violated, strict=True)
        if violated
    ]
    broken.sort(key=lambda item: -item['violated'])
    if as_json:
        print_json(
            {
                'samples': len(data),
                'shares': shares,
                'violated_rules': broken,
                'smallest_margin': number(np.nanmin(judgement.margin))
                if (judgement.verdict != Verdict.UNKNOWN).any()
                else None,
            }
        )
    else:
        parts = ', '.join(f'{share:.2%} {name}' for name, share in shares.items())
        click.echo(f'{len(data)} samples: {parts}')
        for item in broken:
            click.echo(f'  {item["violated"]:>7} x  {item["id"]:<9} {item["text"]}')
    return 0 if shares['SAFE'] == 1.0 else 1


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
    from occ_constraints_pkg.report.scores import describe_score, score_document
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    data = read_data(paths, loaded, constraints)
    if data.true_cost is None:
        raise OccError(
            f'{", ".join(paths)}: no true cost to score on; needed is a column true_cost in the '
            'pace topic of a recording, or cost or true_cost in a table'
        )
    result = score_rules(loaded.rule_set, data.values, data.true_cost)
    if as_json:
        print_json(score_document(result, loaded.rule_set.space))
    else:
        click.echo(describe_score(result, loaded.rule_set.space))
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
@JSON
def prune(constraints: str, threshold: float, output: str | None, as_json: bool) -> None:
    """Disable rules that are rarely violated, by the counters in the file.

    The counters come from `occ check --count`, from a monitor (~/prune) or from `occ train`.

    \b
    Example: occ prune constraints.yaml --threshold 0.001 -o pruned.yaml
    """
    from occ_constraints_pkg.learning.pruning import prune as prune_rules
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    result = prune_rules(loaded.rule_set, threshold)
    pruned = loaded.with_rule_set(result.rule_set)
    target = output or constraints
    pruned.save(target)
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
    click.echo(describe_rules(pruned, counters=True))
    click.echo(f'{len(result.pruned)} rules disabled; written to {target}')


@click.group()
def export() -> None:
    """Write rules in a form that other programs use without this package.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """


@export.command()
@click.argument('constraints', type=click.Path())
@click.option('-o', '--output', type=click.Path(), help='File to write; default: stdout.')
@click.option('--prefix', default='occ', show_default=True, help='Begins every name in the file.')
def c(constraints: str, output: str | None, prefix: str) -> None:
    """Write the rules as one C99 header with a function PREFIX_judge.

    It gives the same verdict, rule and margin as the monitor.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """
    from occ_constraints_pkg.files import replacing
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.rules.export_c import export_c

    text = export_c(load_constraints(constraints).rule_set, prefix)
    if output is None:
        click.echo(text, nl=False)
        return
    with replacing(output) as draft:
        draft.write_text(text, encoding='utf-8')
    click.echo(f'Written to {output}')
