// Makes elements of the page.
//
// Invariant: text from programs and messages becomes text nodes only. Nothing here parses markup.

const SVG = 'http://www.w3.org/2000/svg';

function apply(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'text') node.textContent = value;
    else if (name === 'on') for (const [event, handler] of Object.entries(value)) node.addEventListener(event, handler);
    else if (name === 'data') Object.assign(node.dataset, value);
    else node.setAttribute(name, value === true ? '' : value);
  }
  for (const child of children) if (child !== null && child !== undefined && child !== false) node.append(child);
  return node;
}

/** Makes an HTML element. `text`, `on` and `data` are its text, its listeners and its data attributes. */
export function element(tag, attributes, ...children) {
  return apply(document.createElement(tag), attributes, children);
}

/** Makes an SVG element. */
export function svgElement(tag, attributes, ...children) {
  return apply(document.createElementNS(SVG, tag), attributes, children);
}

/** Makes a button. */
export function button(label, handler, attributes = {}, ...children) {
  return element('button', { type: 'button', ...attributes, on: { click: handler } }, ...children, label);
}

/** Sets the text of a node, if it differs: a node that did not change is not laid out again. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Sets or removes an attribute, if it differs. */
export function setAttribute(node, name, value) {
  if (value === null || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else {
    const text = value === true ? '' : String(value);
    if (node.getAttribute(name) !== text) node.setAttribute(name, text);
  }
}

/** Switches a button off without taking the focus from it: `aria-disabled`, and its handler asks `isOff`. */
export function setOff(node, off) {
  setAttribute(node, 'aria-disabled', off ? 'true' : null);
}

/** Whether a button was switched off by `setOff`. */
export function isOff(node) {
  return node.getAttribute('aria-disabled') === 'true';
}

/** Replaces the children of a node. */
export function setChildren(node, ...children) {
  node.replaceChildren(...children.filter(child => child !== null && child !== undefined && child !== false));
}
