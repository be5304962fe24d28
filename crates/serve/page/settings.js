// Keeps the choices of this page's user: theme, unit of length, name of the page, what is open.
//
// Invariant: they change what is displayed and nothing that is sent to the machine, the page's name excepted.

const NAMES = ['theme', 'unit', 'pageName', 'wasWelcomed', 'heightChart'];
const listeners = new Set();

function stored(name, otherwise) {
  try {
    return localStorage.getItem(`retrace.${name}`) ?? otherwise;
  } catch {
    return otherwise;
  }
}

const values = {
  theme: stored('theme', 'auto'),
  unit: stored('unit', 'mm'),
  pageName: stored('pageName', ''),
  wasWelcomed: stored('wasWelcomed', ''),
  heightChart: stored('heightChart', 'closed'),
};

/** Value of a setting. */
export function setting(name) {
  return values[name];
}

/** Changes a setting and reports it to the listeners. */
export function changeSetting(name, value) {
  if (!NAMES.includes(name)) throw new Error(`no setting ${name}`);
  values[name] = value;
  try {
    localStorage.setItem(`retrace.${name}`, value);
  } catch {
    /* private windows keep nothing */
  }
  applyTheme();
  for (const listener of listeners) listener(name);
}

/** Calls the listener with the name of each setting that changes. */
export function onSettingChange(listener) {
  listeners.add(listener);
}

const light = matchMedia('(prefers-color-scheme: light)');

/** Theme that is shown: `dark` or `light`. */
export function shownTheme() {
  return values.theme === 'auto' ? (light.matches ? 'light' : 'dark') : values.theme;
}

/** Whether the user wants as little motion as possible. */
export function prefersLittleMotion() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}

function applyTheme() {
  document.documentElement.dataset.theme = shownTheme();
}

light.addEventListener('change', () => {
  applyTheme();
  for (const listener of listeners) listener('theme');
});
applyTheme();
