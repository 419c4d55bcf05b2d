'use strict';
// Shows what the server tells. Whatever comes from robots is set as text, never as markup, and
// nothing is kept but the newest message of each kind, and the margins of the last minutes.
(() => {
  const {element, drawn, short, count, lineChart} = charts;
  // Without news for so long, nothing that is shown is of now.
  const STALE_MS = 2000, CHECK_MS = 500, RETRY_MS = 2000;
  // Spans of a sparkline that share one column, of which the worst is drawn.
  const PER_COLUMN = 5, SPARK_HEIGHT = 24;
  const MOST_ROWS = 100;
  const SIGNS = {SAFE: '✓', VIOLATED: '▲', UNKNOWN: '?', LOST: '✕', PASS: '✓', SLOW: '◐', STOP: '■'};
  const KINDS = {violation: '▲ violation', unknown: '? unknown', near_miss: '≈ near miss', stop: '■ stop', trigger: '● recording asked for'};
  const WORST_FIRST = ['VIOLATED', 'UNKNOWN', 'LOST', 'SAFE'];
  const at = id => document.getElementById(id);

  let state = null, rules = {}, log = {events: [], changes: [], recorders: 0};
  let heardAt = -Infinity, wasStale = null, chosen = '', token = '', asked = null;
  // Of each robot its margins, one for each span; 'last' is the number of the newest span.
  const margins = new Map();
  let spans = 600, spanSeconds = 0.5;
  // Of each robot what is drawn.
  const cards = new Map();

  // ---- small helpers: nothing is touched that is as it should be ----
  function say(node, text) {
    if (node.textContent !== text) node.textContent = text;
  }
  function name(node, text) {
    if (node.className !== text) node.className = text;
  }
  function put(node, attribute, value) {
    if (node.getAttribute(attribute) !== value) node.setAttribute(attribute, value);
  }
  // Makes a node have so many children, made by a function where they lack.
  function sized(parent, length, make) {
    while (parent.childElementCount > length) parent.lastElementChild.remove();
    while (parent.childElementCount < length) parent.append(make());
    return parent.children;
  }
  function showState(node, word, text, more = '') {
    say(node, (SIGNS[word] ? SIGNS[word] + ' ' : '') + text);
    name(node, 'state ' + word + more);
  }
  const clock = seconds => {
    const moment = new Date(seconds * 1000), time = moment.toLocaleTimeString('en-GB');
    const isToday = moment.toDateString() === new Date().toDateString();
    return isToday ? time : moment.toLocaleDateString('en-CA') + ' ' + time;
  };
  const isStale = () => performance.now() - heardAt > STALE_MS;
  // What a robot is shown as: nobody is safe of whom this page has no news.
  const standingOf = robot => isStale() ? 'LOST' : robot.standing in SIGNS ? robot.standing : 'UNKNOWN';
  const whyOf = robot => isStale() ? 'this page has no connection to its server' : robot.why;

  // ---- the stream ----
  function connect() {
    const stream = new EventSource('/stream');
    const take = (kind, use) => stream.addEventListener(kind, event => use(JSON.parse(event.data)));
    take('now', takeNow);
    take('past', takePast);
    take('rules', told => { rules = told.sets; });
    take('log', told => { log = told; showLog(); });
    stream.addEventListener('error', () => {
      // The browser connects again by itself, but not after a refusal.
      if (stream.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    });
  }
  function takeNow(told) {
    heardAt = performance.now();
    const before = state;
    state = told;
    for (const robot of told.robots) {
      const own = advance(robot.id, told.bucket);
      robot.recent.forEach((margin, i) => { own.values[spans - robot.recent.length + i] = margin; });
    }
    const ids = new Set(told.robots.map(robot => robot.id));
    for (const id of margins.keys()) if (!ids.has(id)) margins.delete(id);
    show(!before || before.bucket !== told.bucket);
  }
  function takePast(told) {
    spanSeconds = told.bucket_seconds;
    for (const [id, values] of Object.entries(told.margins)) {
      spans = values.length;
      margins.set(id, {last: told.bucket, values});
    }
    if (state) show(true);
  }
  function advance(id, bucket) {
    if (!margins.has(id)) margins.set(id, {last: bucket, values: new Array(spans).fill(null)});
    const own = margins.get(id), steps = Math.min(bucket - own.last, spans);
    if (steps > 0) {
      own.values.splice(0, steps);
      for (let i = 0; i < steps; i++) own.values.push(null);
    }
    own.last = bucket;
    return own;
  }

  // ---- everything ----
  function show(isNewSpan) {
    const stale = isStale();
    wasStale = stale;
    document.body.classList.toggle('stale', stale);
    const link = at('link');
    name(link, stale ? 'lost' : '');
    say(link, !stale ? 'live' : state ? 'no connection: what is shown was so at ' + clock(state.time) : 'connecting …');
    if (!state) return;
    const robots = state.robots;
    at('nobody').hidden = robots.length > 0;
    if (!robots.some(robot => robot.id === chosen)) chosen = robots.length ? robots[0].id : '';
    showCounts(robots);
    showCards(robots, isNewSpan);
    showDetail(robots.find(robot => robot.id === chosen), isNewSpan);
  }
  function showCounts(robots) {
    const words = WORST_FIRST.filter(word => robots.some(robot => standingOf(robot) === word));
    const items = sized(at('counts'), words.length, () => element('li'));
    words.forEach((word, i) => showState(items[i], word, robots.filter(robot => standingOf(robot) === word).length + ' ' + word));
    const bad = robots.filter(robot => standingOf(robot) !== 'SAFE').length;
    const title = (bad ? '▲ ' + bad + ' of ' : '') + count(robots.length, 'robot');
    if (document.title !== title) document.title = title;
  }

  // ---- the list of robots ----
  function newCard(id) {
    const button = element('button', {type: 'button', class: 'robot'});
    const parts = {state: element('span'), called: element('span', {class: 'called'}), margin: element('span', {class: 'number'}),
      spark: drawn('svg', {class: 'spark', preserveAspectRatio: 'none', role: 'img'}), gates: element('span', {class: 'gates'}),
      why: element('span', {class: 'why'})};
    parts.lines = ['unknown', 'violated', 'trace', 'zero'].map(kind => drawn('path', {class: kind}));
    parts.spark.append(...parts.lines);
    button.append(parts.state, parts.called, parts.margin, parts.spark, parts.gates, parts.why);
    button.addEventListener('click', () => choose(id));
    return {button, ...parts};
  }
  function showCards(robots, isNewSpan) {
    const list = at('robots'), ids = new Set(robots.map(robot => robot.id));
    for (const [id, card] of cards) {
      if (ids.has(id)) continue;
      card.button.remove();
      cards.delete(id);
    }
    const rank = robot => WORST_FIRST.indexOf(standingOf(robot));
    const ordered = at('order').value === 'worst' ? robots.toSorted((a, b) => rank(a) - rank(b)) : robots;
    ordered.forEach((robot, place) => {
      if (!cards.has(robot.id)) cards.set(robot.id, newCard(robot.id));
      const card = cards.get(robot.id), standing = standingOf(robot);
      // Only what is out of place is moved, for the focus is lost by it.
      if (list.children[place] !== card.button) list.insertBefore(card.button, list.children[place] || null);
      card.button.hidden = at('unsafe').checked && standing === 'SAFE';
      name(card.button, 'robot ' + standing);
      put(card.button, 'aria-current', String(robot.id === chosen));
      showState(card.state, standing, standing);
      say(card.called, robot.name);
      put(card.called, 'title', robot.name);
      say(card.margin, standing === 'SAFE' || standing === 'VIOLATED' ? marginText(robot.margin) : '–');
      say(card.why, remarkOf(robot));
      const gates = sized(card.gates, robot.gates.length, () => element('span'));
      robot.gates.forEach((gate, i) => showState(gates[i], gateState(gate), gateWords(gate), ' gate'));
      if (isNewSpan) drawSpark(card, robot);
    });
  }
  const marginText = margin => margin === null ? '?' : margin.toFixed(3);
  const gateState = gate => isStale() ? 'LOST' : gate.state;
  const gateWords = gate => gateState(gate) + (gateState(gate) === 'SLOW' && gate.scale !== null ? ' ' + Math.round(gate.scale * 100) + ' %' : '');
  function remarkOf(robot) {
    const remarks = [];
    if (robot.health.publishers > 1) remarks.push(robot.health.publishers + ' publishers of verdicts');
    if (robot.recorded) remarks.push('played back, not live');
    if (whyOf(robot)) remarks.push(whyOf(robot));
    else if (robot.next) remarks.push('next ' + robot.next[0] + (robot.next[1] === null ? '' : ' in ' + robot.next[1].toFixed(1) + ' s (estimate)'));
    return remarks.join('; ');
  }
  // Worst of each column: unknown before violated before the smallest margin.
  function columnsOf(values) {
    const columns = [];
    for (let first = 0; first < values.length; first += PER_COLUMN) {
      const group = values.slice(first, first + PER_COLUMN).filter(value => value !== null);
      columns.push(group.includes('?') ? '?' : group.length ? Math.min(...group) : null);
    }
    return columns;
  }
  function drawSpark(card, robot) {
    const own = margins.get(robot.id);
    if (!own) return;
    const columns = columnsOf(own.values), numbers = columns.filter(Number.isFinite);
    const high = Math.max(...numbers, 1e-9), low = Math.min(...numbers, 0);
    const y = value => (SPARK_HEIGHT - 2 - (value - low) / (high - low) * (SPARK_HEIGHT - 4)).toFixed(1);
    const paths = {unknown: '', violated: '', trace: '', zero: 'M0 ' + y(0) + 'H' + columns.length};
    let isBroken = true;
    columns.forEach((value, x) => {
      if (value === '?') paths.unknown += 'M' + x + ' 0h1v' + SPARK_HEIGHT + 'h-1z';
      else if (value !== null && value <= 0) paths.violated += 'M' + x + ' 0h1v' + SPARK_HEIGHT + 'h-1z';
      const isNumber = Number.isFinite(value);
      if (isNumber) paths.trace += (isBroken ? 'M' : 'L') + (x + 0.5) + ' ' + y(value);
      isBroken = !isNumber;
    });
    put(card.spark, 'viewBox', '0 0 ' + columns.length + ' ' + SPARK_HEIGHT);
    put(card.spark, 'aria-label', numbers.length ? 'smallest margin of the last ' + minutes() + ': ' + short(Math.min(...numbers)) : 'no margins');
    for (const line of card.lines) put(line, 'd', paths[line.getAttribute('class')]);
  }
  const minutes = () => count(Math.round(spans * spanSeconds / 60), 'minute');

  function choose(id) {
    chosen = id;
    history.replaceState(null, '', '#' + encodeURIComponent(id));
    show(true);
    showLog();
  }
  at('robots').addEventListener('keydown', event => {
    const steps = {ArrowDown: 1, ArrowUp: -1, j: 1, k: -1, Home: -Infinity, End: Infinity};
    if (!(event.key in steps) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const shown = [...at('robots').children].filter(button => !button.hidden);
    const place = Math.max(0, Math.min(shown.length - 1, shown.indexOf(document.activeElement) + steps[event.key]));
    if (!shown[place]) return;
    shown[place].focus();
    shown[place].click();
  });

  // ---- the chosen robot ----
  function showDetail(robot, isNewSpan) {
    at('detail').hidden = !robot;
    if (!robot) return;
    const standing = standingOf(robot);
    say(at('name'), robot.name);
    if (!at('standing').firstChild) at('standing').append(element('span'), ' ', element('span'));
    const [badge, why] = at('standing').children;
    showState(badge, standing, standing);
    say(why, [remarkOf(robot), robot.problem].filter(Boolean).join('; '));
    if (isNewSpan) drawChart(robot);
    showRules(robot);
    const gates = robot.gates.length ? robot.gates : [null];
    const items = sized(at('gates'), gates.length, () => {
      const item = element('li');
      item.append(element('span'), ' ', element('span'));
      return item;
    });
    gates.forEach((gate, i) => {
      const [word, words] = items[i].children;
      if (!gate) {
        say(word, '');
        name(word, '');
        say(words, 'no gate listens to these verdicts');
        return;
      }
      showState(word, gateState(gate), gateWords(gate), ' gate');
      say(words, gate.name + (gate.reason ? ': ' + gate.reason : '') + (gate.since ? ' (since ' + clock(gate.since) + ')' : ''));
    });
    showHealth(robot);
    showControl(robot);
  }
  let chartWidth = 0;
  function drawChart(robot) {
    const own = margins.get(robot.id), place = at('chart');
    if (!own) return;
    const from = -(spans - 1) * spanSeconds;
    const points = own.values.map((value, i) => [from + i * spanSeconds, Number.isFinite(value) ? value : null]);
    const unknown = [];
    own.values.forEach((value, i) => {
      if (value !== '?') return;
      const begin = from + i * spanSeconds, last = unknown[unknown.length - 1];
      if (last && last[1] >= begin - 1e-9) last[1] = begin + spanSeconds;
      else unknown.push([begin, begin + spanSeconds]);
    });
    const known = points.filter(point => point[1] !== null);
    const least = known.reduce((a, b) => b[1] < a[1] ? b : a, [null, Infinity]);
    chartWidth = place.clientWidth;
    place.replaceChildren(lineChart({width: chartWidth, height: 170, from, to: 0, points, unknown, worst: least[0],
      title: 'smallest margin in each half second; violated at 0 and below',
      label: 'margin over the last ' + minutes() + (known.length ? ', smallest ' + short(least[1]) : ', nothing known'),
      limits: [{bound: 0, operator: '<='}], time: moment => moment ? Math.round(-moment) + ' s ago' : 'now'}));
  }
  function showRules(robot) {
    at('change-title').hidden = !canChange();
    const texts = rules[robot.rule_set] || [];
    const largest = Math.max(...robot.rules.map(row => row[1] === null ? 0 : Math.abs(row[1])), 1e-9);
    const lines = sized(at('rules'), robot.rules.length, newRule);
    robot.rules.forEach(([index, margin, values, violated, evaluated], i) => {
      const [id, words, isEnabled, note] = texts[index] || ['…', '', true, ''];
      const line = lines[i], [head, number, when, now, counted, change] = line.children;
      const isViolated = isEnabled && margin !== null && margin <= 0;
      name(line, !isEnabled ? 'disabled' : isViolated ? 'violated' : '');
      say(head, id);
      say(number.firstChild, !isEnabled ? 'off' : margin === null ? '?' : (isViolated ? '▲ ' : '') + margin.toFixed(3));
      name(number.lastChild, isViolated ? 'bar violated' : 'bar');
      number.lastChild.style.width = isEnabled && margin !== null ? Math.round(100 * Math.abs(margin) / largest) + '%' : '0';
      say(when, words + (note ? ' (' + note + ')' : ''));
      say(now, values);
      say(counted, violated === null ? '' : violated + ' of ' + evaluated);
      change.hidden = !canChange();
      const button = change.firstChild;
      say(button, isEnabled ? 'disable' : 'enable');
      button.dataset.rule = id;
      button.dataset.action = isEnabled ? 'disable_rule' : 'enable_rule';
      put(button, 'aria-label', button.textContent + ' rule ' + id);
    });
    const left = texts.length - robot.rules.length;
    say(at('more'), !robot.rules.length ? 'no rules have been heard of yet' : left > 0 ? count(left, 'rule') + ' farther from its bound, or off' : '');
  }
  function newRule() {
    const line = element('tr'), number = element('td', {class: 'number'}), change = element('td');
    number.append(element('span'), element('span', {class: 'bar'}));
    const button = element('button', {type: 'button'});
    button.addEventListener('click', () => ask(button.dataset.action, button.dataset.rule));
    change.append(button);
    line.append(element('th', {scope: 'row'}), number, element('td'), element('td'), element('td', {class: 'number counted'}), change);
    return line;
  }
  function showHealth(robot) {
    const {monitor, rate, age, delay, publishers, subscribers, queue, doubts} = robot.health;
    const facts = [
      ['monitor', monitor || 'not known', false],
      ['verdicts', rate.toFixed(1) + ' a second', rate === 0],
      ['newest verdict', age === null ? 'none yet' : age.toFixed(1) + ' s ago', age === null || age > 2],
      ['age of its input then', delay === null ? 'not known' : Math.round(delay * 1000) + ' ms', delay !== null && delay > 1],
      ['publishers', String(publishers), publishers !== 1],
      ['other subscribers', String(subscribers), false],
      ['waiting here', queue[0] + ' of ' + queue[1], queue[0] >= queue[1] && queue[1] > 0],
      ['sensors', doubts || 'no doubt', Boolean(doubts)],
    ];
    const cells = sized(at('health'), 2 * facts.length, () => element(at('health').childElementCount % 2 ? 'dd' : 'dt'));
    facts.forEach(([word, text, isDoubtful], i) => {
      say(cells[2 * i], word);
      say(cells[2 * i + 1], text);
      name(cells[2 * i + 1], isDoubtful ? 'doubtful' : '');
    });
  }

  // ---- events and changes ----
  function showLog() {
    const robot = state && state.robots.find(item => item.id === chosen);
    const isWanted = event => !at('own').checked || !robot || event.robot.split('#')[0] === robot.name;
    const events = log.events.filter(isWanted).slice(0, MOST_ROWS);
    say(at('no-events'), events.length ? '' : log.recorders ? 'no event yet' : 'No event_recorder is heard; the list below has what this page has seen itself.');
    at('event-rows').replaceChildren(...events.map(eventRow));
    at('changes').replaceChildren(...log.changes.map(([when, source, kind, text]) => {
      const row = element('tr');
      row.append(element('td', {}, clock(when)), element('td', {}, source), element('td', {}, kind), element('td', {}, text));
      return row;
    }));
    if (!asked) return;
    const answer = log.changes.find(([when, source, kind]) => when >= asked && (kind === 'done' || kind === 'failed'));
    if (answer) {
      say(at('answer'), answer[2] + ': ' + answer[3]);
      asked = null;
    }
  }
  function eventRow(event) {
    const isOpen = event.ended === null;
    const row = element('tr', {class: isOpen ? 'open' : '', title: 'event ' + event.id});
    // Most texts say the reason themselves.
    const more = [event.values, event.text.includes(event.reason) ? '' : event.reason].filter(Boolean);
    const what = element('td', {}, [(KINDS[event.kind] || event.kind) + ': ' + event.text, ...more].join('; '));
    if (event.bag) what.append(element('code', {}, event.bag));
    const lasted = isOpen ? 'going on' : event.began === null ? '' : Math.max(0, event.ended - event.began).toFixed(1) + ' s';
    row.append(element('td', {}, event.began === null ? '?' : clock(event.began)), element('td', {}, event.robot), what,
      element('td', {class: 'number'}, lasted), element('td', {class: 'number'}, event.margin === null ? '' : short(event.margin)));
    return row;
  }

  // ---- changes that are asked for ----
  const canChange = () => Boolean(state && state.control && token && !isStale());
  function showControl(robot) {
    at('control').hidden = !state.control;
    at('unlock').hidden = Boolean(token);
    at('buttons').hidden = !token;
    for (const button of at('buttons').children) button.disabled = !canChange();
    at('control').dataset.robot = robot.id;
  }
  const ACTIONS = [
    ['enable', 'Let it judge', 'judge again'],
    ['disable', 'Judge nothing', 'judge nothing, so that a gate stops the robot'],
    ['prune', 'Prune rules', 'disable the rules that were rarely violated'],
    ['reset_stats', 'Reset statistics', 'set all counters to 0'],
  ];
  for (const [action, text] of ACTIONS) {
    const button = element('button', {type: 'button', 'data-action': action}, text);
    button.addEventListener('click', () => ask(action, ''));
    at('buttons').append(button);
  }
  function ask(action, rule) {
    const robot = state.robots.find(item => item.id === chosen);
    if (!robot || !canChange()) return;
    const known = ACTIONS.find(item => item[0] === action);
    const what = known ? known[2] : action.replace('_', ' ') + ' ' + rule;
    say(at('question'), robot.name + ': ' + what + '?');
    at('ask').returnValue = 'no';
    at('ask').onclose = () => { if (at('ask').returnValue === 'yes') send({action, robot: robot.id, ...rule ? {rule} : {}}); };
    at('ask').showModal();
  }
  async function send(wish) {
    asked = state.time;
    say(at('answer'), 'asked …');
    try {
      const answer = await fetch('/control', {method: 'POST', body: JSON.stringify(wish), cache: 'no-store',
        headers: {'Content-Type': 'application/json', Authorization: 'Bearer ' + token}});
      if (answer.ok) return;
      const {error} = await answer.json();
      if (answer.status === 401) unlock('');
      say(at('answer'), 'refused: ' + error);
    } catch {
      say(at('answer'), 'failed: the server does not answer');
    }
    asked = null;
  }
  function unlock(text) {
    token = text;
    if (token) sessionStorage.setItem('token', token);
    else sessionStorage.removeItem('token');
    if (state) show(false);
  }
  at('unlock').addEventListener('submit', event => {
    event.preventDefault();
    // No header can carry another text.
    const text = at('token').value.trim();
    at('token').value = '';
    if (/^[\x21-\x7e]+$/.test(text)) unlock(text);
  });

  // ---- begin ----
  const hash = location.hash.slice(1);
  if (hash.startsWith('token=')) {
    // Out of the address, so that it is not copied along with it.
    unlock(hash.slice(6));
    history.replaceState(null, '', location.pathname);
  } else {
    token = sessionStorage.getItem('token') || '';
    try {
      chosen = decodeURIComponent(hash);
    } catch {
      chosen = '';
    }
  }
  for (const id of ['order', 'unsafe']) at(id).addEventListener('change', () => show(false));
  at('own').addEventListener('change', showLog);
  setInterval(() => { if (isStale() !== wasStale) show(false); }, CHECK_MS);
  window.addEventListener('resize', () => { if (state && at('chart').clientWidth !== chartWidth) show(true); });
  connect();
})();
