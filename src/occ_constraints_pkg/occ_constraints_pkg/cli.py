# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ``."""

from __future__ import annotations

import json
import math
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

import occ_constraints_pkg
from occ_constraints_pkg.errors import OccError, import_needed
from occ_constraints_pkg.experiments.benchmarks import BENCHMARKS
from occ_constraints_pkg.learning.settings import OCTreeSettings

_FEATURE_MAP_HELP = 'Feature map: a YAML file, or a built-in name such as PointGoal1.'
_DATA = click.argument('paths', metavar='DATA...', nargs=-1, required=True, type=click.Path())
_JSON = click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``occ``; return 0 (done), 1 (problems were found) or 2 (bad input)."""
    handler = signal.getsignal(signal.SIGTERM)
    try:
        code = cli.main(args=None if argv is None else list(argv), standalone_mode=False)
        return code if isinstance(code, int) else 0
    except OccError as error:
        click.echo(f'error: {error}', err=True)
        return 2
    except click.ClickException as error:
        context = getattr(error, 'ctx', None)
        hint = f"; see '{context.command_path} --help'" if context else ''
        click.echo(f'error: {error.format_message().rstrip(".")}{hint}', err=True)
        return 2
    except (click.Abort, KeyboardInterrupt):
        click.echo('stopped', err=True)
        return 130
    except SystemExit:
        # This is how click says that the reader of our output has gone, as in `occ show | head`.
        return 0
    finally:
        signal.signal(signal.SIGTERM, handler)


@click.group(invoke_without_command=True, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(occ_constraints_pkg.__version__)
@click.pass_context
def cli(context: click.Context) -> None:
    """Learn a robot's safety constraints from demonstrations, monitor them, train within them."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@cli.command()
@_DATA
@click.option('-m', '--map', 'map_name', help=f'{_FEATURE_MAP_HELP} Recordings need one.')
@click.option('-o', '--output', default='constraints.yaml', show_default=True, type=click.Path())
@click.option(
    '--depth', default=OCTreeSettings.max_depth, show_default=True, help='Most levels of splits.'
)
@click.option(
    '--clip',
    default=OCTreeSettings.clip,
    show_default=True,
    type=click.Choice(['mass', 'density']),
    help='How outliers are cut off per split.',
)
@click.option(
    '--contamination',
    type=float,
    default=OCTreeSettings.contamination,
    help='With mass: share of the demonstrated samples that may lie outside; estimated if absent.',
)
@click.option(
    '--gamma',
    default=OCTreeSettings.gamma,
    show_default=True,
    help='With density: share of the largest density below which values are outliers.',
)
@click.option(
    '--alpha',
    default=OCTreeSettings.alpha,
    show_default=True,
    help='How deep a minimum of the density must be to split there.',
)
@click.option(
    '--full-conditions',
    is_flag=True,
    help='Write rules with all bounds above them, as the paper does, not only those they need.',
)
@click.option(
    '--faithful',
    is_flag=True,
    help="The tree article's settings (density, gamma 0.05, alpha 0.5, beta 0.02, nu 0.1, full "
    'conditions); --gamma and --alpha, if given, change them, and --depth replaces nu.',
)
@click.option(
    '--seed',
    default=0,
    type=click.IntRange(min=0),
    show_default=True,
    help='Chooses the held-out episodes.',
)
@click.option('--overwrite', is_flag=True, help='Replace a file with edited rules (keeps .bak).')
@_JSON
def learn(
    paths: tuple[str, ...],
    map_name: str | None,
    output: str,
    depth: int,
    clip: str,
    contamination: float | None,
    gamma: float,
    alpha: float,
    full_conditions: bool,
    faithful: bool,
    seed: int,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Learn constraints from safe driving: recordings, or tables (.npz, .csv, .parquet).

    \b
    Example: occ learn bags/safe_drive_1 bags/safe_drive_2 -m my_robot.yaml -o constraints.yaml
    """
    import numpy as np

    from occ_constraints_pkg.bags.demonstrations import learn_from_recordings, learn_from_tables
    from occ_constraints_pkg.bags.feature_map import load_feature_map
    from occ_constraints_pkg.bags.table_files import are_table_files
    from occ_constraints_pkg.rules.constraints_file import save_learned

    settings = OCTreeSettings(
        max_depth=depth,
        clip=clip,
        contamination=contamination,
        gamma=gamma,
        alpha=alpha,
        full_conditions=full_conditions,
    )
    if faithful:
        settings = _article_settings(settings)
    rng = np.random.default_rng(seed)
    feature_map = None if map_name is None else load_feature_map(map_name)
    if are_table_files(paths):
        constraints = learn_from_tables(
            paths, settings, rng=rng, feature_map=feature_map, warn=_warn
        )
    elif feature_map is None:
        raise OccError(f'recordings such as {paths[0]} need a feature map: -m FILE or a name')
    else:
        with _progress('reading') as progress:
            constraints = learn_from_recordings(
                paths, feature_map, settings, rng=rng, progress=progress, warn=_warn
            )
    save_learned(constraints, output, overwrite=overwrite)
    coverage = constraints.coverage
    if as_json:
        _print_json({'output': output, 'rules': len(constraints.rule_set.rules), **coverage})
        return
    click.echo(describe_rules(constraints))
    click.echo(
        f'\nInside the safe set: {coverage["training"]:.2%} of '
        f'{coverage["training_samples"]} training samples'
        + (
            ''
            if coverage['held_out'] is None
            else f', {coverage["held_out"]:.2%} of {coverage["held_out_samples"]} samples of '
            f'{coverage["held_out_episodes"]} held-out episodes'
        )
    )
    click.echo(f'Written to {output}')


def _article_settings(given: OCTreeSettings) -> OCTreeSettings:
    """Return the article's settings, but for those named on the command line."""
    context = click.get_current_context()
    named = {
        name
        for name in context.params
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    }
    if 'contamination' in named or ('clip' in named and given.clip != 'density'):
        raise OccError(
            '--faithful clips by density and knows no contamination; allowed beside it are '
            '--depth, --gamma and --alpha'
        )
    overrides: dict[str, Any] = {
        name: getattr(given, name) for name in ('gamma', 'alpha') if name in named
    }
    if 'depth' in named:
        overrides.update(max_depth=given.max_depth, nu=None)
    return OCTreeSettings.article(**overrides)


def describe_rules(constraints: Any, *, counters: bool = False) -> str:
    """Return the rules of a constraints file as text, one line each."""
    rule_set = constraints.rule_set
    enabled = len(rule_set.order)
    head = '1 rule; it describes' if enabled == 1 else f'{enabled} rules; each describes'
    lines = [f'{head} a violation:']
    for rule in sorted(rule_set.rules, key=lambda rule: (not rule.enabled, len(rule.literals))):
        line = f'  {rule.id:<9} {rule.words(rule_set.space)}'
        if counters and rule.evaluated:
            line += f'   [violated {rule.violated} of {rule.evaluated}]'
        if not rule.enabled:
            line += '   (disabled)'
        if rule.note:
            line += f'   # {rule.note}'
        lines.append(line)
    return '\n'.join(lines)


@cli.command()
@click.argument('constraints', type=click.Path())
@_JSON
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
        _print_json({'rule_set': rule_set.fingerprint, 'edited': loaded.is_edited, 'rules': rules})
        return
    click.echo(describe_rules(loaded, counters=True))


@cli.command()
@_DATA
@click.option('-c', '--constraints', required=True, type=click.Path(), help='Constraints file.')
@click.option(
    '--count',
    'counted',
    type=click.Path(),
    help='Write the constraints file with counters of these recordings, for `occ prune`.',
)
@_JSON
def check(paths: tuple[str, ...], constraints: str, counted: str | None, as_json: bool) -> int:
    """Judge recordings or tables by a constraints file; exit code 1 when a sample is not SAFE.

    \b
    Example: occ check bags/drive_7 -c constraints.yaml
    """
    import numpy as np

    from occ_constraints_pkg.rules import RuleCounts, Verdict
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    loaded = load_constraints(constraints)
    data = _read_for_rules(paths, loaded, constraints)
    rule_set = loaded.rule_set
    if not len(rule_set.order):
        _warn(f'{constraints} enables no rule, so nothing is a violation')
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
        _print_json(
            {
                'samples': len(data),
                'shares': shares,
                'violated_rules': broken,
                'smallest_margin': _number(np.nanmin(judgement.margin))
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


@cli.command()
@click.argument('constraints', type=click.Path())
@_DATA
@click.option('--min-f1', type=click.FloatRange(0.0, 1.0), help='Exit code 1 when F1 is below.')
@_JSON
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
    data = _read_for_rules(paths, loaded, constraints)
    if data.true_cost is None:
        raise OccError(
            f'{", ".join(paths)}: no true cost to score on; needed is a column true_cost in the '
            'pace topic of a recording, or cost or true_cost in a table'
        )
    result = score_rules(loaded.rule_set, data.values, data.true_cost)
    if as_json:
        _print_json(score_document(result, loaded.rule_set.space))
    else:
        click.echo(describe_score(result, loaded.rule_set.space))
    # Without flagged and costly samples there is no F1, which is not enough either.
    return 0 if min_f1 is None or result.overall.f1 >= min_f1 else 1


@cli.command()
@click.argument('constraints', type=click.Path())
@click.option(
    '-t',
    '--threshold',
    default=0.001,
    show_default=True,
    help='Disable rules violated in a smaller share of their evaluations.',
)
@click.option('-o', '--output', type=click.Path(), help='File to write; default: in place.')
@_JSON
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
        _print_json(
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


@cli.command()
@click.argument('world')
@click.option(
    '-o',
    '--output',
    required=True,
    type=click.Path(),
    help='Directory for policy, metrics and checkpoint.',
)
@click.option(
    '--cost',
    default='true',
    show_default=True,
    help="'true': the world's own cost; 'none': unconstrained; or a constraints file.",
)
@click.option('--cost-limit', default=25.0, show_default=True, help='Mean cost per episode.')
@click.option(
    '--steps', default=1_000_000, type=click.IntRange(min=1), show_default=True, help='Robot steps.'
)
@click.option(
    '--robots',
    default=64,
    type=click.IntRange(min=1),
    show_default=True,
    help='Robots simulated at once.',
)
@click.option('--seed', default=0, type=click.IntRange(min=0), show_default=True)
def train(
    world: str, output: str, cost: str, cost_limit: float, steps: int, robots: int, seed: int
) -> None:
    """Train a policy in one process, without ROS.

    \b
    Example: occ train PointGoal1 --cost constraints.yaml --steps 1000000 -o runs/mine
    """
    from occ_constraints_pkg.agents.rule_cost import RuleCost
    from occ_constraints_pkg.agents.training import TrainingDirectory, TrueCost
    from occ_constraints_pkg.agents.training import train as run_training
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.worlds.registry import make_world

    ppo = import_needed('occ train', 'occ_constraints_pkg.agents.ppo_lagrangian')
    config = ppo.PPOLagrangianConfig(cost_limit=cost_limit, lagrangian=cost != 'none')
    simulated = make_world(world, robots)
    constraints = None
    source: Any = TrueCost()
    if cost not in ('true', 'none'):
        constraints = load_constraints(cost)
        source = RuleCost(constraints, simulated)
    learner = ppo.PPOLagrangian(
        config, simulated.columns, simulated.action_columns, simulated.name, seed
    )
    directory = TrainingDirectory(output)
    earlier = directory.begin()
    if earlier:
        click.echo(f'an earlier training is now in {earlier}', err=True)
    _end_tidily()
    try:
        with _progress('training', detail=True) as progress:
            run_training(
                simulated,
                learner,
                source,
                seed=seed,
                total_steps=steps,
                directory=directory,
                progress=lambda metrics: progress(
                    metrics.steps,
                    steps,
                    f'return {metrics.mean_return:.1f} cost {metrics.mean_cost:.1f} '
                    f'multiplier {metrics.multiplier:.2f} {metrics.steps_per_s:.0f} steps/s',
                ),
            )
    finally:
        # A stopped training is not lost.
        directory.save(learner)
        if learner.updates and constraints is not None:
            counted = constraints.rule_set.with_counts(source.counts)
            constraints.with_rule_set(counted).save(directory.path / 'constraints.yaml')
        simulated.close()
        if learner.updates:
            click.echo(f'policy, checkpoint and metrics are in {output}')
        else:
            click.echo('stopped before the first update; nothing was learned', err=True)


@cli.command()
@click.argument('policy', type=click.Path())
@click.option('--world', help='Default: the one the policy was trained on.')
@click.option('--episodes', default=50, type=click.IntRange(min=1), show_default=True)
@click.option('--seed', default=1, type=click.IntRange(min=0), show_default=True)
@click.option('--explore', is_flag=True, help='Sample actions instead of taking the mean.')
@_JSON
def evaluate(
    policy: str, world: str | None, episodes: int, seed: int, explore: bool, as_json: bool
) -> None:
    """Drive fresh episodes with a trained policy; print return and true cost.

    \b
    Example: occ evaluate runs/mine/policy.npz --episodes 50
    """
    import numpy as np

    from occ_constraints_pkg.agents.evaluation import evaluate as run_evaluation
    from occ_constraints_pkg.agents.policy import GaussianPolicy
    from occ_constraints_pkg.worlds.registry import make_world

    trained = GaussianPolicy.load(policy)
    simulated = make_world(world or trained.world, min(episodes, 64))
    trained.check_world(simulated.columns, simulated.action_columns)
    rng = np.random.default_rng(seed) if explore else None
    result = run_evaluation(
        simulated, lambda rows: trained.act(rows, rng), episodes=episodes, seed=seed
    )
    simulated.close()
    numbers = result.as_dict()
    if as_json:
        _print_json(numbers)
        return
    for name, value in numbers.items():
        click.echo(f'{name}: {value:.3f}')


@cli.command(context_settings={'ignore_unknown_options': True, 'allow_extra_args': True})
@click.argument('name')
@click.argument('arguments', nargs=-1, type=click.UNPROCESSED)
def node(name: str, arguments: tuple[str, ...]) -> int:
    """Run a ROS 2 node; what follows its name are ROS arguments.

    The nodes are sim, policy, recorder, player, tree_learner, monitor and constrained_learner.

    \b
    Example: occ node monitor -p constraints_file:=constraints.yaml -r __ns:=/robot1
    """
    from occ_constraints_pkg.nodes import run

    return run(name, ['--ros-args', *arguments])


@cli.command()
@click.argument('topics', nargs=-1)
@click.option('-o', '--output', required=True, type=click.Path(), help='Directory of the new bag.')
def record(topics: tuple[str, ...], output: str) -> int:
    """Record topics (default: all) to a bag until Ctrl-C.

    \b
    Example: occ record odom scan cmd_vel -o bags/drive_7
    """
    from occ_constraints_pkg.nodes import run

    return run('recorder', _parameters(output=output, topics=list(topics)))


@cli.command()
@click.argument('bag', type=click.Path())
@click.option('--rate', default=1.0, show_default=True, help='Speed, 1.0: as recorded.')
@click.option('--loop', is_flag=True, help='Start again at the end.')
@click.option('--topic', 'topics', multiple=True, help='Play only this topic; may be repeated.')
def play(bag: str, rate: float, loop: bool, topics: tuple[str, ...]) -> int:
    """Publish the messages of a recording.

    \b
    Example: occ play bags/drive_7 --rate 2
    """
    from occ_constraints_pkg.nodes import run

    return run('player', _parameters(bag=bag, rate=rate, loop=loop, topics=list(topics)))


@cli.command()
@click.option('-o', '--output', default='demo_output', show_default=True, type=click.Path())
@click.option('--train-seconds', default=120.0, show_default=True)
def demo(output: str, train_seconds: float) -> int:
    """Run the whole loop on PointGoal1: record, learn, monitor, train; write a page.

    \b
    Example: occ demo
    """
    # Some are needed at the end only, but a missing module must show now.
    for module in ('report.demo_page', 'experiments.witness'):
        import_needed('occ demo', f'occ_constraints_pkg.{module}')
    run_demo = import_needed('occ demo', 'occ_constraints_pkg.experiments.demo').run_demo
    _end_tidily()
    return run_demo(Path(output), train_seconds=train_seconds)


@cli.command(epilog=''.join(f'\b\n{name}: {words}\n\n' for name, words in BENCHMARKS.items()))
@click.argument('name', type=click.Choice(list(BENCHMARKS)))
@click.option(
    '--seconds',
    type=click.FloatRange(min=0.0, min_open=True),
    help="Measured time per form; default: the benchmark's own.",
)
@_JSON
def bench(name: str, seconds: float | None, as_json: bool) -> None:
    """Measure speed; prints metrics, what ran beside them, machine and versions.

    \b
    Example: occ bench loop --json
    """
    module = import_needed(
        f'occ bench {name}', f'occ_constraints_pkg.experiments.benchmarks.{name}'
    )
    _end_tidily()
    result = module.run() if seconds is None else module.run(seconds)
    if as_json:
        _print_json(result)
        return
    for part in ('metrics', 'peers'):
        for key, value in result[part].items():
            click.echo(f'{key}: {value:.4g}')


@cli.group()
def experiment() -> None:
    """Repeat published experiments.

    \b
    Example: occ experiment article --set Iris
    """


@experiment.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option('--splits', default=20, show_default=True, help='Random splits per line.')
@click.option('--seed', default=0, show_default=True)
@click.option(
    '--data',
    type=click.Path(),
    help='Folder of the CSV files; default: oneclass in OCC_TEST_DATA or in ../shared/data.',
)
@click.option('--set', 'sets', multiple=True, help='Run only this data set; may be repeated.')
@_JSON
def article(
    output: str, splits: int, seed: int, data: str | None, sets: tuple[str, ...], as_json: bool
) -> None:
    """Repeat the tree article's benchmark; writes article.json and article.md.

    A stopped run goes on where it was. Needs scikit-learn.

    \b
    Example: occ experiment article --set Iris -o results
    """
    module = import_needed('occ experiment', 'occ_constraints_pkg.experiments.article')
    with _progress('lines') as progress:
        result = module.run_article(
            Path(output),
            splits=splits,
            seed=seed,
            folder=Path(data) if data else None,
            names=sets,
            progress=progress,
        )
    for reason in result['skipped'].values():
        click.echo(f'skipped: {reason}', err=True)
    if as_json:
        _print_json(result)
        return
    click.echo((Path(output) / 'article.md').read_text(encoding='utf-8'))


def _end_tidily() -> None:
    """Let SIGTERM do what Ctrl-C does: a training is saved, the nodes of a demo are ended."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def _read_for_rules(paths: tuple[str, ...], constraints: Any, where: str) -> Any:
    """Read data to judge, and pass on what was wrong with it."""
    from occ_constraints_pkg.bags.demonstrations import read_for_rules

    with _progress('reading') as progress:
        data = read_for_rules(paths, constraints, where, progress=progress)
    for warning in data.warnings:
        _warn(warning)
    return data


def _warn(sentence: str) -> None:
    click.echo(f'warning: {sentence}', err=True)


def _parameters(**values: Any) -> list[str]:
    """Return node parameters as ROS arguments; empty ones are left to their defaults."""
    arguments = ['--ros-args']
    for name, value in values.items():
        if value not in ('', []):
            arguments += ['-p', f'{name}:={json.dumps(value)}']
    return arguments


@contextmanager
def _progress(label: str, *, detail: bool = False) -> Iterator[Callable[..., None]]:
    """Show a bar on stderr, only on a terminal; yields ``update(done, total, text='')``."""
    hidden = not sys.stderr.isatty()
    with click.progressbar(
        length=1,
        label=label,
        file=sys.stderr,
        hidden=hidden,
        item_show_func=(lambda text: text) if detail else None,
    ) as bar:

        def update(done: int, total: int, text: str = '') -> None:
            if hidden:
                return
            bar.length = total
            bar.update(done - bar.pos, text)

        yield update


def _print_json(value: Any) -> None:
    click.echo(json.dumps(value, indent=2, allow_nan=False, default=_plain))


def _plain(value: Any) -> Any:
    if hasattr(value, 'item'):
        # A NumPy number.
        return value.item()
    raise TypeError(f'cannot write {type(value).__name__} as JSON')


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
