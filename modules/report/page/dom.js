// SPDX-License-Identifier: GPL-3.0-or-later
// Elements from words. Text from the data only ever becomes text.

/** An element; attributes by name, children are elements or texts. */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** A table; columns are [title, row => text, isNumber]. */
export function table(columns, rows) {
  const cell = (kind, text, number) => element(kind, number ? {class: 'number'} : {}, text);
  const head = element('tr', {}, ...columns.map(([title, , number]) => cell('th', title, number)));
  const body = rows.map((row) =>
    element('tr', {}, ...columns.map(([, text, number]) => cell('td', String(text(row)), number))));
  return element('div', {class: 'scroll'}, element('table', {}, element('thead', {}, head), element('tbody', {}, ...body)));
}

/** 1.234 +- 0.005 with the digits that the data carry. */
export function plusMinus(value, sigma, unit = '') {
  const text = value === null || value === undefined ? 'unknown' : String(value);
  const spread = sigma === null || sigma === undefined ? '' : ` ± ${sigma}`;
  return `${text}${spread}${unit ? ` ${unit}` : ''}`;
}
