// Puts the parts of the page together and starts the connection.
//
// Invariant: live figures are written once a frame, from the newest message; messages never queue up behind pictures.

import { ActionTable } from './actions.js';
import { Connection } from './connection.js';
import { ContourList } from './contour_list.js';
import { ContourTable } from './contour_table.js';
import { ControlDialog } from './control_dialog.js';
import { FeedPanel } from './feed_panel.js';
import { FilePanel } from './file_panel.js';
import { HeightChart } from './height_chart.js';
import { HelpPanel } from './help_panel.js';
import { JobPanel } from './job_panel.js';
import { JogPad } from './jog_pad.js';
import { Keyboard } from './keyboard.js';
import { Listing } from './listing.js';
import { LogPanel } from './log_panel.js';
import { MachineDialogs } from './machine_dialogs.js';
import { MachineStore } from './machine_store.js';
import { MdiPanel } from './mdi_panel.js';
import { MotionKeys } from './motion_keys.js';
import { Notices } from './notices.js';
import { OffsetPanel } from './offset_panel.js';
import { OrderSender } from './orders.js';
import { PathView } from './path_view.js';
import { PositionTable } from './position_table.js';
import { ProbePanel } from './probe_panel.js';
import { ProfilePanel } from './profile_panel.js';
import { Scrubber } from './scrubber.js';
import { SettingsPanel } from './settings_panel.js';
import { ShopPanel } from './shop_panel.js';
import { StateLine } from './state_line.js';
import { Tabs } from './tabs.js';
import { ToolPanel } from './tool_panel.js';
import { ZeroPanel } from './zero_panel.js';
import { element } from './element.js';
import { openActionDialog } from './action_dialog.js';
import { followSignIn } from './sign_in.js';
import { formatBytes } from './units.js';
import { onSettingChange } from './settings.js';
import { setDialogPlace } from './dialog.js';

const place = id => document.getElementById(id);

const store = new MachineStore();
setDialogPlace(place('dialogs'));
const notices = new Notices(place('notices'), place('message-line'));
/** The drawing, for tests of where something is in it. */
export let pathView = null;
const connection = new Connection({
  onMessage: message => store.apply(message),
  onChunk: message => pathView?.acceptChunk(message),
  onLink: link => {
    store.setLink(link);
    document.body.dataset.link = link;
  },
});
const orders = new OrderSender(connection, store, notices);
const actions = new ActionTable(store, orders);
// An order that was passed on and that the machine then did not carry out.
store.on('rejected', rejected => notices.refuse(rejected));
store.on('offer', ({ name, bytes }) =>
  notices.offer({
    text: `${name} is new in the watched folder (${formatBytes(bytes)}).`,
    label: 'Load',
    mayRun: () => {
      if (store.allows('open-program')) return true;
      notices.refuse({ cause: 'a program is loaded by the page in control, while none runs' });
      return false;
    },
    run: () => orders.send(`open ${name}`),
  }),
);

const stageTabs = new Tabs(place('stage-tabs'), place('stage'), 'stage');
const sideTabs = new Tabs(place('side-tabs'), place('side'), 'side');
const openTab = (tabs, id) => () => tabs.select(id);

const pathPanel = { node: element('div', { class: 'path-place' }) };
const contourTable = new ContourTable(store, connection);
pathView = new PathView(pathPanel.node, store, { connection, orders, actions, contours: contourTable });
pathPanel.onShow = () => pathView.requestFrame();
const jogPad = new JogPad(store, orders, actions);
const listing = new Listing(store, connection, orders);
const zeroPanel = new ZeroPanel(store, orders, actions);
const contourList = new ContourList(store, orders, contourTable);
const mdiPanel = new MdiPanel(store, orders);
const feedPanel = new FeedPanel(place('feed'), store, orders, actions);
const helpPanel = new HelpPanel(store, actions);
/** The strip chart, for tests of what it keeps. */
export const heightChart = new HeightChart(place('height-chart'), store);

stageTabs.add('path', 'Path', pathPanel);
stageTabs.add('files', 'Files', new FilePanel(store, connection, orders));
stageTabs.add('jobs', 'Jobs', new JobPanel(store, connection, orders));
stageTabs.add('shop', 'Shop', new ShopPanel(store, connection, orders));
stageTabs.add('offsets', 'Offsets', new OffsetPanel(store, connection, orders));
stageTabs.add('tools', 'Tools', new ToolPanel(store, connection, orders, actions));
stageTabs.add('profile', 'Profile', new ProfilePanel(store, connection, notices));
stageTabs.add('log', 'Log', new LogPanel(store, connection, notices));
stageTabs.add('settings', 'Settings', new SettingsPanel(store, connection, actions));
stageTabs.add('help', 'Help', helpPanel);
sideTabs.add('program', 'Program', listing);
sideTabs.add('jog', 'Jog', jogPad);
sideTabs.add('mdi', 'MDI', mdiPanel);
sideTabs.add('zero', 'Zero', zeroPanel);
sideTabs.add('probe', 'Probe', new ProbePanel(store, orders));
sideTabs.add('contours', 'Contours', contourList);
// On a narrow screen the overrides and outputs have no room of their own: this tab shows them.
sideTabs.add('feed', 'Feed', { node: element('div') }, 'only-narrow');
document.body.dataset.shown = 'stage';
const followShown = () => {
  document.body.dataset.feed = String(sideTabs.selected === 'feed');
};
sideTabs.onSelect = followShown;
// A contour that is selected in the drawing is shown in the list, unless the list would cover the drawing.
contourTable.on(from => {
  if (from !== 'path' || contourTable.number === null) return;
  if (place('side').offsetParent !== null) sideTabs.select('contours');
});

actions.register({
  messages: openTab(stageTabs, 'log'),
  help: openTab(stageTabs, 'help'),
  tools: openTab(stageTabs, 'tools'),
  'open-program': openTab(stageTabs, 'files'),
  'shop-jobs': openTab(stageTabs, 'shop'),
  contours: openTab(sideTabs, 'contours'),
  jog: openTab(sideTabs, 'jog'),
  mdi: () => {
    sideTabs.select('mdi');
    mdiPanel.input.focus();
  },
  probe: openTab(sideTabs, 'probe'),
  'work-zero': openTab(sideTabs, 'zero'),
});

const machineDialogs = new MachineDialogs(store, orders, actions);
const controlDialog = new ControlDialog(store, orders, connection);
new StateLine(place('state-line'), store, actions, {
  openAlarm: () => machineDialogs.reopen(),
  openActions: () => openActionDialog(store, actions),
  openControl: () => controlDialog.open(),
});
const positionTable = new PositionTable(place('position'), store, { openZero: openTab(sideTabs, 'zero') });
jogPad.onKeyAxis = index => positionTable.setKeyAxis(index);
const scrubber = new Scrubber(place('scrubber'), store, orders, actions, pathView);
new MotionKeys(place('motion-keys'), store, actions, orders);
new Keyboard(store, orders, actions, { jogPad, pathView });
followSignIn(store, connection);

// Figures that change more often than this cannot be read, and each change is drawn, on some computers by the processor
// that plans the motion.
const FIGURES_MS = 66;
let frame = null,
  figuresAt = -Infinity,
  figuresLater = null;
const figures = [positionTable, feedPanel, scrubber];
function showFigures() {
  clearTimeout(figuresLater);
  figuresLater = null;
  figuresAt = performance.now();
  for (const part of figures) part.show();
  if (sideTabs.selected === 'program') listing.show();
  if (sideTabs.selected === 'zero') zeroPanel.show();
}
function showLive() {
  frame = null;
  const left = figuresAt + FIGURES_MS - performance.now();
  if (left <= 0) showFigures();
  else figuresLater ??= setTimeout(showFigures, left);
  if (stageTabs.selected === 'path') pathView.show();
}
store.on('live state', () => {
  frame ??= requestAnimationFrame(showLive);
});
onSettingChange(() => {
  frame ??= requestAnimationFrame(showLive);
});
store.on('hello', () => helpPanel.welcome());

document.addEventListener('dragover', event => event.preventDefault());
document.addEventListener('drop', event => event.preventDefault());
connection.start();
