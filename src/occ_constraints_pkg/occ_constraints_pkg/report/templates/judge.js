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

// Places of the enabled rules in order of evaluation: fewest literals first.
function evaluationOrder(rules) {
  const places = rules.map((_, place) => place).filter(place => rules[place].enabled);
  return places.sort((a, b) => rules[a].literals.length - rules[b].literals.length || a - b);
}

// rows: {count, known: Uint8Array, columns: [Float64Array]}. Returns the verdict of each row, and the
// first rule that is true, -1 for none.
function judge(rules, rows) {
  const order = evaluationOrder(rules);
  const verdict = new Uint8Array(rows.count), first = new Int32Array(rows.count).fill(-1);
  for (let row = 0; row < rows.count; row++) {
    if (!order.length || !rows.known[row]) { verdict[row] = UNKNOWN; continue; }
    for (const place of order) {
      const literals = rules[place].literals;
      let all = true;
      for (let i = 0; i < literals.length && all; i++) {
        const literal = literals[i];
        all = holds(literal.operator, rows.columns[literal.column][row], literal.bound);
      }
      if (all) { verdict[row] = VIOLATED; first[row] = place; break; }
    }
  }
  return {verdict, first};
}

// Little-endian numbers in base64.
function unpack(text, kind) {
  const bytes = Uint8Array.from(atob(text), sign => sign.charCodeAt(0));
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
