'use strict';
// What all pages share: small helpers, and a line chart with limits.
const charts = (() => {
  const SVG = 'http://www.w3.org/2000/svg';
  // Traces of more points have no dots of their own.
  const MOST_DOTS = 120;

  function element(name, attributes = {}, text = '') {
    return filled(document.createElement(name), attributes, text);
  }
  function drawn(name, attributes = {}, text = '') {
    return filled(document.createElementNS(SVG, name), attributes, text);
  }
  function filled(made, attributes, text) {
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  }
  const short = value => Number(value.toPrecision(4)).toString();
  const count = (number, word) => number + ' ' + word + (number === 1 ? '' : 's');

  // Draws values over time as SVG.
  //   title, label: above it, and for those who cannot see it
  //   from, to, time: the span of time, and how a moment is written
  //   points: [moment, value] in order; where a value is null the line is broken
  //   limits: {bound, operator, moved}, violated where value operator bound; moved may be bound
  //   during: [from, to] of a violation, or none
  //   unknown: spans [from, to] of which nothing is known
  //   worst: moment of the point that is marked, or none
  function lineChart({width, title, label, from, to, time, points, limits, during = null, unknown = [],
    worst = null, height: HEIGHT = 210}) {
    const WIDTH = Math.max(280, width), LEFT = 62, RIGHT = 14, TOP = 26, BOTTOM = 30;
    const known = points.filter(point => point[1] !== null);
    let low = Infinity, high = -Infinity;
    for (const value of known.map(point => point[1]).concat(limits.flatMap(item => [item.bound, item.moved ?? item.bound]))) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    const seen = [low, high];
    const room = (high - low) * 0.14 || Math.abs(high) * 0.1 || 1;
    low -= room;
    high += room;
    const x = moment => LEFT + (moment - from) / (to - from) * (WIDTH - LEFT - RIGHT);
    const y = value => TOP + (high - value) / (high - low) * (HEIGHT - TOP - BOTTOM);
    const area = {x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM};
    const svg = drawn('svg', {width: WIDTH, height: HEIGHT, class: 'chart', role: 'img', 'aria-label': label});
    const span = (begin, end) => ({...area, x: x(begin), width: Math.max(2, x(end) - x(begin))});
    for (const item of limits) {
      const edge = y(item.bound), isAbove = item.operator.startsWith('>');
      const beyond = {...area, y: isAbove ? TOP : edge,
        height: Math.max(0, isAbove ? edge - TOP : HEIGHT - BOTTOM - edge)};
      svg.append(drawn('rect', {...beyond, class: 'beyond'}), drawn('rect', {...beyond, fill: 'url(#beyond)'}));
    }
    for (const [begin, end] of unknown) {
      svg.append(drawn('rect', {...span(begin, end), class: 'unknown'}), drawn('rect', {...span(begin, end), fill: 'url(#dots)'}));
    }
    if (during) svg.append(drawn('rect', {...span(...during), class: 'during'}));
    svg.append(drawn('rect', {...area, class: 'frame'}));
    const labelled = [];
    function mark(value, name) {
      const at = y(value);
      if (labelled.some(other => Math.abs(other - at) < 14)) return;
      labelled.push(at);
      svg.append(drawn('text', {x: LEFT - 6, y: at + 4, 'text-anchor': 'end', class: name}, short(value)));
    }
    const line = (name, value) => svg.append(drawn('line', {class: name, x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value)}));
    for (const item of limits) {
      line('limit', item.bound);
      mark(item.bound, 'bound-label');
      if ((item.moved ?? item.bound) !== item.bound) {
        line('newlimit', item.moved);
        mark(item.moved, 'moved-label');
      }
    }
    seen.forEach(value => mark(value, 'end-label'));
    for (const piece of pieces(points)) {
      svg.append(drawn('polyline', {class: 'trace', points: piece.map(([t, v]) => x(t).toFixed(1) + ',' + y(v).toFixed(1)).join(' ')}));
    }
    if (known.length <= MOST_DOTS) {
      for (const [t, v] of known) svg.append(drawn('circle', {class: 'dot', cx: x(t).toFixed(1), cy: y(v).toFixed(1), r: 2.2}));
    }
    const peak = known.find(point => point[0] === worst);
    if (peak) {
      const isLate = x(peak[0]) > WIDTH - 90;
      svg.append(drawn('circle', {class: 'worst', cx: x(peak[0]), cy: y(peak[1]), r: 6}));
      svg.append(drawn('text', {class: 'peak', x: x(peak[0]) + (isLate ? -10 : 10), 'text-anchor': isLate ? 'end' : 'start',
        y: Math.max(TOP + 12, y(peak[1]) - 8)}, short(peak[1])));
    }
    svg.append(drawn('text', {class: 'title', x: LEFT, y: 16}, title));
    const [first, last] = during || [from, to];
    for (const [moment, anchor] of [[from, 'start'], [(first + last) / 2, 'middle'], [to, 'end']]) {
      svg.append(drawn('text', {class: 'moment', x: x(moment), y: HEIGHT - 10, 'text-anchor': anchor}, time(moment)));
    }
    return svg;
  }

  // Runs of points between those without a value.
  function pieces(points) {
    const found = [];
    let isBroken = true;
    for (const point of points) {
      if (point[1] === null) {
        isBroken = true;
        continue;
      }
      if (isBroken) found.push([]);
      isBroken = false;
      found[found.length - 1].push(point);
    }
    return found;
  }

  return {element, drawn, short, count, lineChart};
})();
