'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const SVG = 'http://www.w3.org/2000/svg';
  // Lists are filled in parts, so that thousands of violations do not delay the page.
  const PART = 200;

  // ---- small helpers ----
  function element(name, attributes = {}, text = '') {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  }
  function drawn(name, attributes = {}, text = '') {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  }
  const short = value => Number(value.toPrecision(4)).toString();
  const time = value => data.unit === 's' ? value.toFixed(3) + ' s' : value.toFixed(0);
  const count = (number, word) => number + ' ' + word + (number === 1 ? '' : 's');
  const at = (attribute, value) => document.querySelector('[data-' + attribute + '="' + value + '"]');

  if (!data.recordings) return;
  const original = data.rules;
  const rules = structuredClone(original);
  const recordings = data.recordings;
  const unpacked = new Map();
  function rowsOf(place) {
    if (!unpacked.has(place)) unpacked.set(place, unpackRows(recordings[place].rows));
    return unpacked.get(place);
  }

  // ---- lists of violations ----
  recordings.forEach((recording, place) => {
    at('begin', place).textContent = time(recording.begin);
    at('end', place).textContent = time(recording.end);
    const jumps = at('jumps', place);
    if (!jumps) return;
    if (jumps.open) fill(place);
    jumps.addEventListener('toggle', () => { if (jumps.open) fill(place); });
  });

  function fill(place) {
    const list = at('list', place);
    if (list.firstChild) return;
    const recording = recordings[place];
    const table = element('table'), head = element('thead'), body = element('tbody');
    const titles = element('tr');
    for (const title of ['', 'from', 'to', 'rule', 'violated when', 'smallest margin']) {
      titles.append(element('th', {scope: 'col'}, title));
    }
    head.append(titles);
    table.append(head, body);
    list.append(table);
    const entries = recording.violations.map((item, number) => ({item, number}));
    const unknown = recording.unknown.map(item => ({unknown: item}));
    const all = entries.concat(unknown);
    const more = element('button', {type: 'button'});
    let shown = 0;
    function next() {
      for (const entry of all.slice(shown, shown + PART)) body.append(line(place, entry));
      shown = Math.min(shown + PART, all.length);
      more.textContent = 'Show ' + Math.min(PART, all.length - shown) + ' of ' + (all.length - shown) + ' more';
      if (shown === all.length) more.remove();
    }
    list.append(more);
    more.addEventListener('click', next);
    next();
    if (entries.length) show(place, 0, false);
  }

  function line(place, entry) {
    const row = element('tr');
    if (entry.unknown) {
      const [, start, end, features] = entry.unknown;
      const why = features.length ? 'UNKNOWN: cannot be judged for ' + features.join(', ') : 'UNKNOWN';
      row.append(element('td'), element('td', {class: 'number'}, time(start)),
        element('td', {class: 'number'}, time(end)), element('td'), element('td', {}, why), element('td'));
      return row;
    }
    const [rule, , start, end, , margin] = entry.item;
    row.dataset.violation = entry.number;
    const button = element('button', {type: 'button', 'aria-label': 'show violation ' + (entry.number + 1)}, '⤢');
    button.addEventListener('click', () => show(place, entry.number, true));
    const first = element('td');
    first.append(button);
    row.append(first, element('td', {class: 'number'}, time(start)), element('td', {class: 'number'}, time(end)),
      element('td', {}, original[rule].id), element('td', {}, original[rule].words),
      element('td', {class: 'number'}, short(margin)));
    return row;
  }

  // ---- one violation: its features against their bounds ----
  const chosen = new Map();
  function show(place, number, moves) {
    const recording = recordings[place], list = at('list', place);
    const [rule, episode, start, end, worst, margin] = recording.violations[number];
    chosen.set(place, number);
    for (const row of list.querySelectorAll('tr.chosen')) row.classList.remove('chosen');
    const row = list.querySelector('[data-violation="' + number + '"]');
    if (row) row.classList.add('chosen');
    const detail = at('detail', place);
    detail.replaceChildren();
    const bar = element('p');
    const previous = element('button', {type: 'button'}, '← previous');
    const following = element('button', {type: 'button'}, 'next →');
    previous.disabled = number === 0;
    following.disabled = number === recording.violations.length - 1;
    previous.addEventListener('click', () => show(place, number - 1, true));
    following.addEventListener('click', () => show(place, number + 1, true));
    bar.append(previous, ' ', following, ' violation ' + (number + 1) + ' of ' + recording.violations.length
      + ', ' + time(start) + ' to ' + time(end) + (end > start ? ' (' + time(end - start) + ')' : '')
      + '; worst at ' + time(worst) + ', margin ' + short(margin));
    detail.append(element('h4', {}, original[rule].id + ': ' + original[rule].words), bar);
    const columns = new Map();
    for (const [i, literal] of original[rule].literals.entries()) {
      if (!columns.has(literal.column)) columns.set(literal.column, []);
      columns.get(literal.column).push([literal, rules[rule].literals[i]]);
    }
    for (const [column, literals] of columns) {
      detail.append(chart(place, column, literals, {episode, start, end, worst}));
    }
    if (moves) (number === 0 || previous.disabled ? following : previous).focus({preventScroll: true});
  }

  function chart(place, column, literals, where) {
    const WIDTH = 960, HEIGHT = 200, LEFT = 70, RIGHT = 16, TOP = 22, BOTTOM = 30;
    const described = data.columns[column], rows = rowsOf(place), values = rows.columns[column];
    const from = where.start - data.context, to = where.end + data.context;
    const points = [];
    for (let i = 0; i < rows.count; i++) {
      if (rows.episodes[i] === where.episode && rows.times[i] >= from && rows.times[i] <= to
          && Number.isFinite(values[i])) points.push([rows.times[i], values[i]]);
    }
    points.sort((a, b) => a[0] - b[0]);
    const limits = literals.flatMap(pair => pair.map(literal => literal.bound));
    let low = Math.min(...points.map(p => p[1]), ...limits), high = Math.max(...points.map(p => p[1]), ...limits);
    const room = (high - low) * 0.12 || Math.abs(high) * 0.1 || 1;
    low -= room; high += room;
    const x = t => LEFT + (t - from) / (to - from) * (WIDTH - LEFT - RIGHT);
    const y = v => TOP + (high - v) / (high - low) * (HEIGHT - TOP - BOTTOM);
    const unit = described.unit ? ' [' + described.unit + ']' : '';
    const words = described.name + unit + ' against its bound ' + literals.map(([l]) => l.operator + ' ' + short(l.bound)).join(' and ');
    const svg = drawn('svg', {viewBox: '0 0 ' + WIDTH + ' ' + HEIGHT, class: 'chart', role: 'img', 'aria-label': words});
    for (const [literal] of literals) {
      const edge = y(literal.bound), above = literal.operator.startsWith('>');
      svg.append(drawn('rect', {class: 'beyond', x: LEFT, width: WIDTH - LEFT - RIGHT,
        y: above ? TOP : edge, height: Math.max(0, above ? edge - TOP : HEIGHT - BOTTOM - edge)}));
    }
    svg.append(drawn('rect', {class: 'during', x: x(where.start), y: TOP,
      width: Math.max(2, x(where.end) - x(where.start)), height: HEIGHT - TOP - BOTTOM}));
    svg.append(drawn('rect', {class: 'frame', x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM}));
    for (const [literal, moved] of literals) {
      const edge = y(literal.bound);
      svg.append(drawn('line', {class: 'limit', x1: LEFT, x2: WIDTH - RIGHT, y1: edge, y2: edge}));
      svg.append(drawn('text', {x: LEFT - 6, y: edge + 4, 'text-anchor': 'end'}, short(literal.bound)));
      if (moved.bound !== literal.bound) {
        svg.append(drawn('line', {class: 'newlimit', x1: LEFT, x2: WIDTH - RIGHT, y1: y(moved.bound), y2: y(moved.bound)}));
      }
    }
    svg.append(drawn('polyline', {class: 'trace', points: points.map(([t, v]) => x(t).toFixed(1) + ',' + y(v).toFixed(1)).join(' ')}));
    if (points.length <= 120) {
      for (const [t, v] of points) svg.append(drawn('circle', {class: 'dot', cx: x(t).toFixed(1), cy: y(v).toFixed(1), r: 2.5}));
    }
    const worst = points.find(p => p[0] === where.worst);
    if (worst) {
      svg.append(drawn('circle', {class: 'worst', cx: x(worst[0]), cy: y(worst[1]), r: 6}));
      svg.append(drawn('text', {x: Math.min(x(worst[0]) + 10, WIDTH - RIGHT - 60), y: Math.max(TOP + 12, y(worst[1]) - 8)}, short(worst[1])));
    }
    svg.append(drawn('text', {x: LEFT, y: 15}, words));
    for (const [t, anchor] of [[from, 'start'], [where.start, 'middle'], [to, 'end']]) {
      svg.append(drawn('text', {x: x(t), y: HEIGHT - 10, 'text-anchor': anchor}, time(t)));
    }
    return svg;
  }

  // ---- what if ----
  function changed() {
    return rules.some((rule, i) => rule.enabled !== original[i].enabled
      || rule.literals.some((literal, j) => literal.bound !== original[i].literals[j].bound));
  }
  function counts(judged) {
    const per = new Array(rules.length).fill(0);
    let violated = 0;
    for (let i = 0; i < judged.verdict.length; i++) {
      if (judged.verdict[i] === VIOLATED) { violated++; per[judged.first[i]]++; }
    }
    return {violated, per};
  }
  const before = recordings.map((_, place) => judge(original, rowsOf(place)));
  function judgeAgain() {
    const isChanged = changed();
    const total = {before: 0, after: 0, fresh: 0, gone: 0, recordings: 0};
    const per = new Array(rules.length).fill(0);
    recordings.forEach((recording, place) => {
      const rows = rowsOf(place);
      const judged = isChanged ? judge(rules, rows) : before[place];
      const now = counts(judged), then = counts(before[place]);
      now.per.forEach((number, rule) => { per[rule] += number; });
      total.before += then.violated;
      total.after += now.violated;
      let differs = false;
      for (let i = 0; i < rows.count; i++) {
        const was = before[place].verdict[i] === VIOLATED, is = judged.verdict[i] === VIOLATED;
        if (is && !was) total.fresh++;
        if (was && !is) total.gone++;
        differs = differs || judged.verdict[i] !== before[place].verdict[i];
      }
      if (differs) total.recordings++;
      band(place, isChanged ? judged : null);
    });
    per.forEach((number, rule) => {
      const cell = at('count', rule);
      if (cell) cell.textContent = number ? number : '';
    });
    const answer = document.getElementById('answer');
    document.getElementById('reset').disabled = !isChanged;
    if (!isChanged) { answer.textContent = ''; return; }
    if (!rules.some(rule => rule.enabled)) { answer.textContent = 'No rule is enabled: every verdict would be UNKNOWN.'; return; }
    answer.textContent = 'With these bounds ' + count(total.after, 'sample') + ' of the page would be violations instead of '
      + total.before + ': ' + total.fresh + ' new, ' + total.gone + ' gone, in ' + count(total.recordings, 'recording')
      + ' (the purple stripes).';
  }
  function band(place, judged) {
    const group = at('whatif', place);
    group.replaceChildren();
    if (!judged) return;
    const recording = recordings[place], rows = rowsOf(place);
    const scale = data.cells / (recording.end - recording.begin);
    const cells = new Uint8Array(data.cells);
    for (let i = 0; i < rows.count; i++) {
      if (judged.verdict[i] !== VIOLATED) continue;
      const first = Math.max(0, Math.min(data.cells - 1, Math.floor((rows.times[i] - recording.begin) * scale)));
      const last = Math.min(data.cells - 1, Math.max(first, Math.ceil((rows.times[i] + rows.lengths[i] - recording.begin) * scale) - 1));
      cells.fill(1, first, last + 1);
    }
    for (let first = 0; first < data.cells; first++) {
      if (!cells[first]) continue;
      let end = first;
      while (end < data.cells && cells[end]) end++;
      group.append(drawn('rect', {class: 'whatif', x: first, y: 26, width: Math.max(1, end - first), height: 8}));
      first = end;
    }
  }
  function mark(rule) {
    const row = at('rule', rule);
    if (!row) return;
    const isChanged = rules[rule].enabled !== original[rule].enabled
      || rules[rule].literals.some((literal, i) => literal.bound !== original[rule].literals[i].bound);
    row.classList.toggle('changed', isChanged);
    row.classList.toggle('disabled', !rules[rule].enabled);
  }
  for (const input of document.querySelectorAll('[data-bound]')) {
    input.addEventListener('input', () => {
      const rule = Number(input.dataset.bound), literal = Number(input.dataset.literal);
      const bound = input.valueAsNumber;
      // While a number is being typed it may be none: the bound of the file holds.
      rules[rule].literals[literal].bound = Number.isFinite(bound) ? bound : original[rule].literals[literal].bound;
      mark(rule);
      judgeAgain();
      for (const [place, number] of chosen) {
        if (recordings[place].violations[number][0] === rule) show(place, number, false);
      }
    });
  }
  for (const box of document.querySelectorAll('[data-enable]')) {
    box.addEventListener('change', () => {
      const rule = Number(box.dataset.enable);
      rules[rule].enabled = box.checked;
      mark(rule);
      judgeAgain();
    });
  }
  const reset = document.getElementById('reset');
  if (reset) {
    reset.addEventListener('click', () => {
      original.forEach((rule, place) => {
        rules[place].enabled = rule.enabled;
        rule.literals.forEach((literal, i) => { rules[place].literals[i].bound = literal.bound; });
        mark(place);
      });
      for (const input of document.querySelectorAll('[data-bound]')) {
        input.value = original[input.dataset.bound].literals[input.dataset.literal].bound;
      }
      for (const box of document.querySelectorAll('[data-enable]')) box.checked = original[box.dataset.enable].enabled;
      judgeAgain();
      for (const [place, number] of chosen) show(place, number, false);
    });
    judgeAgain();
  }
})();
