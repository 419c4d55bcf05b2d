'use strict';
// What rules mean, as in the package: see occ_constraints_pkg/rules/ruleset.py.
const SAFE = 0, VIOLATED = 1, UNKNOWN = 2;

function holds(operator, value, bound) {
  switch (operator) {
    case '<': return value < bound;
    case '<=': return value <= bound;
    case '>': return value > bound;
    case '>=': return value >= bound;
    default: throw new Error('operator ' + operator);
  }
}

function isTrue(rule, columns, row) {
  // Not by a function for each literal: this runs for every rule on every row.
  for (let i = 0; i < rule.literals.length; i++) {
    const literal = rule.literals[i];
    if (!holds(literal.operator, columns[literal.column][row], literal.bound)) return false;
  }
  return true;
}

// Places of the enabled rules in order of evaluation: fewest literals first.
function evaluationOrder(rules) {
  const places = rules.map((_, place) => place).filter(place => rules[place].enabled);
  return places.sort((a, b) => rules[a].literals.length - rules[b].literals.length || a - b);
}

// rows: {count, known: Uint8Array, columns: [Float64Array]}. Returns the verdict of each row, and
// the first rule that is true, -1 for none. Without enabled rules, every verdict is UNKNOWN.
function judge(rules, rows) {
  const order = evaluationOrder(rules);
  const verdict = new Uint8Array(rows.count), first = new Int32Array(rows.count).fill(-1);
  for (let row = 0; row < rows.count; row++) {
    if (!order.length || !rows.known[row]) { verdict[row] = UNKNOWN; continue; }
    for (const place of order) {
      if (isTrue(rules[place], rows.columns, row)) {
        verdict[row] = VIOLATED;
        first[row] = place;
        break;
      }
    }
  }
  return {verdict, first};
}

// Little-endian numbers in base64.
function unpack(text, kind) {
  const signs = atob(text), bytes = new Uint8Array(signs.length);
  for (let i = 0; i < signs.length; i++) bytes[i] = signs.charCodeAt(i);
  return new kind(bytes.buffer);
}

function unpackRows(rows) {
  return {
    count: rows.count,
    times: unpack(rows.times, Float64Array),
    lengths: unpack(rows.lengths, Float32Array),
    episodes: unpack(rows.episodes, Int32Array),
    known: unpack(rows.known, Uint8Array),
    columns: rows.columns.map(column => unpack(column, Float64Array)),
  };
}
