'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  if (!data.recordings) return;
  // Lists are filled in parts, so that thousands of violations do not delay the page.
  const PART = 200;
  const {element, drawn, short, count, lineChart} = charts;
  const time = value => data.unit === 's' ? value.toFixed(2) + ' s' : value.toFixed(0);
  const at = (name, value) => document.querySelector('[data-' + name + '="' + value + '"]');

  const original = data.rules;
  const rules = structuredClone(original);
  const recordings = data.recordings;
  const unpacked = new Map();
  // The violation that each recording shows.
  const chosen = new Map();
  function rowsOf(place) {
    if (!unpacked.has(place)) {
      const rows = unpackRows(recordings[place].rows);
      // Rows of one episode follow one another, which those of robots in a table do not.
      const {episodes, times} = rows;
      const compare = (a, b) => episodes[a] - episodes[b] || times[a] - times[b];
      rows.order = Uint32Array.from(times, (_, row) => row);
      // Most are in order, and to see that takes a fraction of the time of sorting.
      if (!rows.order.every(row => !row || compare(row - 1, row) <= 0)) rows.order.sort(compare);
      unpacked.set(place, rows);
    }
    return unpacked.get(place);
  }
  // Rows of an episode from one moment to another, both included, in order of time.
  function rowsWithin(place, episode, from, to) {
    const rows = rowsOf(place), {order, episodes, times} = rows;
    let low = 0, high = order.length;
    while (low < high) {
      const middle = (low + high) >> 1, row = order[middle];
      if (episodes[row] < episode || (episodes[row] === episode && times[row] < from)) low = middle + 1;
      else high = middle;
    }
    const found = [];
    for (; low < order.length && episodes[order[low]] === episode && times[order[low]] <= to; low++) found.push(order[low]);
    return found;
  }

  // ---- lists of violations ----
  recordings.forEach((recording, place) => {
    at('begin', place).textContent = time(recording.begin);
    at('end', place).textContent = time(recording.end);
    const jumps = at('jumps', place);
    if (!jumps) return;
    jumps.addEventListener('toggle', () => { if (jumps.open) fill(place); });
    if (!recording.violations.length) return;
    const band = at('band', place);
    band.classList.add('clickable');
    band.addEventListener('click', event => {
      const box = band.getBoundingClientRect();
      const share = (event.clientX - box.left) / box.width;
      const clicked = recording.begin + share * (recording.end - recording.begin);
      const away = ([, , start, end]) => Math.max(start - clicked, clicked - end, 0);
      let nearest = 0;
      recording.violations.forEach((item, number) => {
        if (away(item) < away(recording.violations[nearest])) nearest = number;
      });
      jumps.open = true;
      fill(place);
      show(place, nearest);
    });
  });

  function fill(place) {
    const list = at('list', place);
    if (list.firstChild) return;
    const recording = recordings[place];
    const table = element('table'), head = element('thead'), body = element('tbody');
    const titles = element('tr');
    // Also where only one of them violates: which one it was is what people ask.
    const hasEpisodes = new Set(rowsOf(place).episodes).size > 1;
    for (const title of ['', 'from', 'to', ...hasEpisodes ? ['episode'] : [], 'rule', 'violated when', 'margin']) {
      titles.append(element('th', {scope: 'col'}, title));
    }
    head.append(titles);
    table.append(head, body);
    list.append(table);
    const all = recording.violations.map((item, number) => violationLine(place, item, number, hasEpisodes))
      .concat(recording.unknown.map(item => unknownLine(item, hasEpisodes)));
    const more = element('button', {type: 'button'});
    let shown = 0;
    function next() {
      body.append(...all.slice(shown, shown + PART));
      shown = Math.min(shown + PART, all.length);
      const left = all.length - shown;
      more.textContent = 'Show ' + Math.min(PART, left) + ' of ' + left + ' more';
      more.hidden = !left;
    }
    list.append(more);
    more.addEventListener('click', next);
    next();
    if (recording.violations.length) show(place, 0);
    markGone(place);
  }

  function unknownLine([episode, start, end, features], hasEpisodes) {
    const row = element('tr');
    const why = features.length ? 'UNKNOWN: cannot be judged for ' + features.join(', ') : 'UNKNOWN';
    row.append(element('td'), element('td', {}, time(start)), element('td', {}, time(end)),
      ...hasEpisodes ? [element('td', {}, String(episode))] : [],
      element('td'), element('td', {}, why), element('td'));
    return row;
  }
  function violationLine(place, [rule, episode, start, end, , margin], number, hasEpisodes) {
    const row = element('tr', {'data-violation': number});
    const label = 'show violation ' + (number + 1) + ' of ' + recordings[place].violations.length;
    const button = element('button', {type: 'button', 'aria-label': label}, '⤢');
    button.addEventListener('click', () => show(place, number));
    const first = element('td');
    first.append(button);
    row.append(first, element('td', {}, time(start)), element('td', {}, time(end)),
      ...hasEpisodes ? [element('td', {}, String(episode))] : [],
      element('td', {}, original[rule].id), element('td', {}, original[rule].words),
      element('td', {class: 'number'}, short(margin)));
    return row;
  }

  // ---- one violation: its features against their bounds ----
  function show(place, number, focus = '') {
    const recording = recordings[place], list = at('list', place);
    const [rule, episode, start, end, worst, margin] = recording.violations[number];
    chosen.set(place, number);
    for (const row of list.querySelectorAll('tr.chosen')) row.classList.remove('chosen');
    const row = list.querySelector('[data-violation="' + number + '"]');
    if (row) row.classList.add('chosen');
    const detail = at('detail', place);
    detail.replaceChildren();
    const bar = element('p', {class: 'steps'});
    const previous = element('button', {type: 'button'}, '← previous');
    const following = element('button', {type: 'button'}, 'next →');
    previous.disabled = number === 0;
    following.disabled = number === recording.violations.length - 1;
    previous.addEventListener('click', () => show(place, number - 1, 'previous'));
    following.addEventListener('click', () => show(place, number + 1, 'next'));
    bar.append(previous, ' ', following, element('span', {}, 'Violation ' + (number + 1) + ' of '
      + recording.violations.length + ', ' + time(start) + ' to ' + time(end)
      + '; worst at ' + time(worst) + ', margin ' + short(margin)));
    detail.append(element('h4', {}, original[rule].id + ': ' + original[rule].words), bar);
    const columns = new Map();
    original[rule].literals.forEach((literal, i) => {
      if (!columns.has(literal.column)) columns.set(literal.column, []);
      columns.get(literal.column).push({bound: literal.bound, operator: literal.operator,
        moved: rules[rule].literals[i].bound});
    });
    for (const [column, literals] of columns) {
      detail.append(chart(place, column, literals, {episode, start, end, worst}, detail.clientWidth));
    }
    if (focus) {
      const wanted = focus === 'previous' ? previous : following;
      (wanted.disabled ? (wanted === previous ? following : previous) : wanted).focus({preventScroll: true});
    }
  }

  function traceOf(place, column, episode, from, to) {
    const rows = rowsOf(place);
    return rowsWithin(place, episode, from, to).map(row => [rows.times[row], rows.columns[column][row]])
      .filter(([, value]) => Number.isFinite(value));
  }

  function chart(place, column, literals, {episode, start, end, worst}, width) {
    const described = data.columns[column], {begin, end: last} = recordings[place];
    const from = Math.max(begin, start - data.context), to = Math.min(last, end + data.context);
    const unit = described.unit ? ' [' + described.unit + ']' : '';
    const title = described.name + unit + ', violated when '
      + literals.map(item => item.operator + ' ' + short(item.bound)).join(' and ');
    return lineChart({width, title, label: title + '; worst at ' + time(worst), from, to, time, worst,
      points: traceOf(place, column, episode, from, to), limits: literals, during: [start, end]});
  }

  let width = window.innerWidth;
  window.addEventListener('resize', () => {
    if (window.innerWidth === width) return;
    width = window.innerWidth;
    for (const [place, number] of chosen) if (at('jumps', place).open) show(place, number);
  });

  // ---- what if ----
  const isChanged = () => rules.some((rule, i) => isRuleChanged(rule, i));
  const isRuleChanged = (rule, i) => rule.enabled !== original[i].enabled
    || rule.literals.some((literal, j) => literal.bound !== original[i].literals[j].bound);
  // By recording, the numbers of the violations that are none with these bounds.
  const gone = new Map();

  // Rows of the page in which a rule is violated, by the rules of the file and by those tried.
  function truths(place, rule) {
    const rows = rowsOf(place);
    const then = new Uint8Array(rows.count), now = new Uint8Array(rows.count);
    for (let row = 0; row < rows.count; row++) {
      if (!rows.known[row]) continue;
      then[row] = original[rule].enabled && isTrue(original[rule], rows.columns, row);
      now[row] = rules[rule].enabled && isTrue(rules[rule], rows.columns, row);
    }
    return {then, now};
  }

  // Runs of rows in which a rule is violated now and nowhere was before; as in a check, short breaks
  // are bridged.
  function newRuns(place, {then, now}) {
    const rows = rowsOf(place);
    let runs = 0, isOld = true, isBroken = true, episode = null, end = 0;
    for (const row of rows.order) {
      if (!now[row]) {
        isBroken = true;
        continue;
      }
      const isApart = isBroken && rows.times[row] - end > data.bridge;
      if (isApart || rows.episodes[row] !== episode) {
        runs += !isOld;
        isOld = false;
      }
      [isBroken, episode, end] = [false, rows.episodes[row], rows.times[row] + rows.lengths[row]];
      isOld = isOld || then[row] === 1;
    }
    return runs + !isOld;
  }

  const remains = (place, [, episode, start, end], now) =>
    rowsWithin(place, episode, start, end).some(row => now[row] && rowsOf(place).times[row] < end);

  function judgeAgain() {
    const total = {violations: 0, gone: 0, fresh: 0, differ: 0};
    const changes = isChanged();
    const changed = rules.map((_, i) => i).filter(i => isRuleChanged(rules[i], i));
    const perRule = new Array(rules.length).fill(0), freshPerRule = new Array(rules.length).fill(0);
    recordings.forEach((recording, place) => {
      const own = new Set();
      let fresh = 0;
      const by = new Map(changed.map(rule => [rule, truths(place, rule)]));
      for (const [rule, found] of by) {
        const runs = newRuns(place, found);
        freshPerRule[rule] += runs;
        fresh += runs;
      }
      recording.violations.forEach((item, number) => {
        if (by.has(item[0]) && !remains(place, item, by.get(item[0]).now)) own.add(number);
        else perRule[item[0]]++;
      });
      gone.set(place, own);
      total.violations += recording.violations.length;
      total.gone += own.size;
      total.fresh += fresh;
      total.differ += own.size || fresh ? 1 : 0;
      drawBand(place, changes ? judge(rules, rowsOf(place)) : null);
      markGone(place);
    });
    perRule.forEach((number, rule) => {
      const cell = at('count', rule);
      if (cell) cell.textContent = String(number + freshPerRule[rule]);
    });
    document.getElementById('whatif').hidden = !changes;
    document.getElementById('answer').textContent = changes ? answer(total) : '';
  }

  function answer(total) {
    if (!rules.some(rule => rule.enabled)) return 'No rule is enabled: every verdict would be UNKNOWN.';
    if (!total.gone && !total.fresh) return 'Nothing changes: all ' + count(total.violations, 'violation') + ' remain, and none is new.';
    const least = data.thinned && total.fresh ? 'at least ' : '';
    return total.violations - total.gone + ' of ' + count(total.violations, 'violation') + ' remain, '
      + total.gone + ' gone, ' + least + total.fresh + ' new, in ' + count(total.differ, 'recording') + '.';
  }

  function markGone(place) {
    const list = at('list', place);
    if (!list) return;
    for (const row of list.querySelectorAll('tr.gone')) row.classList.remove('gone');
    for (const number of gone.get(place) || []) {
      const row = list.querySelector('[data-violation="' + number + '"]');
      if (row) row.classList.add('gone');
    }
  }

  function drawBand(place, judged) {
    const group = at('whatif', place);
    group.replaceChildren();
    if (!judged) return;
    const recording = recordings[place], rows = rowsOf(place);
    const scale = data.cells / (recording.end - recording.begin);
    const cells = new Uint8Array(data.cells);
    for (let row = 0; row < rows.count; row++) {
      if (judged.verdict[row] !== VIOLATED) continue;
      const begin = (rows.times[row] - recording.begin) * scale;
      const first = Math.max(0, Math.min(data.cells - 1, Math.floor(begin)));
      const end = Math.max(first + 1, Math.ceil(begin + rows.lengths[row] * scale));
      cells.fill(1, first, Math.min(data.cells, end));
    }
    for (let first = 0; first < data.cells; first++) {
      if (!cells[first]) continue;
      let end = first;
      while (end < data.cells && cells[end]) end++;
      group.append(drawn('rect', {class: 'whatif', x: first, y: 26, width: end - first, height: 8}));
      first = end;
    }
  }

  function tried(rule) {
    const row = at('rule', rule);
    row.classList.toggle('changed', isRuleChanged(rules[rule], rule));
    row.classList.toggle('disabled', !rules[rule].enabled);
    judgeAgain();
    for (const [place, number] of chosen) {
      if (recordings[place].violations[number][0] === rule && at('jumps', place).open) show(place, number);
    }
  }
  for (const input of document.querySelectorAll('[data-bound]')) {
    input.addEventListener('input', () => {
      const rule = Number(input.dataset.bound), literal = Number(input.dataset.literal);
      const bound = input.valueAsNumber;
      // While a number is being typed it may be none: the bound of the file holds.
      rules[rule].literals[literal].bound = Number.isFinite(bound) ? bound : original[rule].literals[literal].bound;
      tried(rule);
    });
  }
  for (const box of document.querySelectorAll('[data-enable]')) {
    box.addEventListener('change', () => {
      rules[box.dataset.enable].enabled = box.checked;
      tried(Number(box.dataset.enable));
    });
  }
  const reset = document.getElementById('reset');
  reset.addEventListener('click', () => {
    for (const input of document.querySelectorAll('[data-bound]')) {
      const bound = original[input.dataset.bound].literals[input.dataset.literal].bound;
      rules[input.dataset.bound].literals[input.dataset.literal].bound = bound;
      input.value = bound;
    }
    for (const box of document.querySelectorAll('[data-enable]')) {
      const rule = Number(box.dataset.enable);
      rules[rule].enabled = box.checked = original[rule].enabled;
      at('rule', rule).classList.remove('changed');
      at('rule', rule).classList.toggle('disabled', !box.checked);
    }
    judgeAgain();
    for (const [place, number] of chosen) if (at('jumps', place).open) show(place, number);
    const main = document.getElementById('rules-title');
    main.tabIndex = -1;
    main.focus({preventScroll: true});
  });

  recordings.forEach((_, place) => {
    const jumps = at('jumps', place);
    if (jumps && jumps.open) fill(place);
  });
  if (document.querySelector('[data-rule]')) judgeAgain();
  // Before the first question, so that its answer need not wait for it.
  window.addEventListener('load', () => setTimeout(() => recordings.forEach((_, place) => rowsOf(place))));
})();
