//! A person at the page of `retrace serve` in a browser: looks, touches, drags, types.
//!
//! Invariant: what is touched is what a person could touch: in view, not switched off, and under nothing else. A page
//! that reports an error fails its test.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use crate::browser::{Browser, DebuggingSocket};
use crate::page_client::PageServer;

/// Longest wait for something to appear on the page.
const TIMEOUT: Duration = Duration::from_secs(60);

/// How often the page is looked at.
const LOOK: Duration = Duration::from_millis(30);

/// Steps of a finger or a mouse on its way.
const DRAG_STEPS: u32 = 8;

/// Looks for an element as a person does; in the page before its own scripts.
const FINDER: &str = r"
window.findByEye = (selector, text) => {
  const isSeen = node => { const box = node.getBoundingClientRect(); return box.width > 0 && box.height > 0; };
  const names = node => [node.textContent.trim(), node.getAttribute('aria-label') ?? ''];
  const node = [...document.querySelectorAll(selector)]
    .find(node => isSeen(node) && (text === '' || names(node).some(name => name.startsWith(text))));
  if (!node) return null;
  const where = () => node.getBoundingClientRect();
  const isOutside = box => box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight;
  if (isOutside(where())) node.scrollIntoView({ block: 'nearest', inline: 'nearest' });
  const box = where(), x = box.left + box.width / 2, y = box.top + box.height / 2;
  const top = document.elementFromPoint(x, y);
  return { x, y, left: box.left, top: box.top, width: box.width, height: box.height,
    isFree: top !== null && (node.contains(top) || top.contains(node)),
    over: top === null ? 'nothing' : `${top.tagName} ${top.id} ${top.className}`,
    isOff: node.getAttribute('aria-disabled') === 'true' || node.disabled === true };
};";

/// The picture of the path stays readable after it was shown.
const KEEP_PICTURE: &str = r"
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, attributes) {
  const isKept = kind === 'webgl2' && !window.picturesPass;
  return getContext.call(this, kind, isKept ? { ...attributes, preserveDrawingBuffer: true } : attributes);
};";

/// The words of the state line that the page has shown since the last tap, key or word that was waited for: one that is
/// shown for a moment is not missed by a test that is late.
const KEEP_WORDS: &str = r"
window.shownWords = [];
new MutationObserver(() => {
  const word = document.querySelector('#state-word span:last-child')?.textContent;
  if (word && window.shownWords.at(-1) !== word) window.shownWords.push(word);
}).observe(document, { childList: true, characterData: true, subtree: true });
window.hasShownWord = (word) => {
  const at = window.shownWords.indexOf(word);
  if (at >= 0) window.shownWords.splice(0, at);
  return at >= 0 || document.querySelector('#state-word span:last-child')?.textContent === word;
};";

/// A screen.
#[derive(Clone, Copy, Debug)]
pub struct Screen {
    /// Width in CSS pixels.
    pub width: u32,
    /// Height in CSS pixels.
    pub height: u32,
    /// Pixels of the screen to a CSS pixel.
    pub ratio: u32,
    /// Whether it is touched; otherwise there is a mouse.
    pub is_touch: bool,
    /// Whether the user prefers light colours.
    pub is_light: bool,
}

impl Screen {
    /// The touch screen at the machine.
    pub const TABLET: Self = Self { width: 1024, height: 768, ratio: 1, is_touch: true, is_light: false };
    /// A phone.
    pub const PHONE: Self = Self { width: 390, height: 844, ratio: 2, is_touch: true, is_light: false };
    /// A desk, with mouse and keyboard.
    pub const DESK: Self = Self { width: 1920, height: 1080, ratio: 1, is_touch: false, is_light: false };

    /// The same in light colours.
    #[must_use]
    pub const fn light(self) -> Self {
        Self { is_light: true, ..self }
    }
}

/// Where an element is.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Its middle.
    pub middle: (f64, f64),
    /// Its left upper corner.
    pub corner: (f64, f64),
    /// Its width and height.
    pub size: (f64, f64),
}

/// A person at the page.
#[derive(Debug)]
pub struct PageUser {
    page: DebuggingSocket,
    screen: Screen,
    /// What complaints contain that a test causes itself.
    forgiven: Vec<String>,
}

impl PageUser {
    /// Sits down at this screen, with an empty page.
    #[must_use]
    pub fn new(browser: &mut Browser, screen: Screen) -> Self {
        let mut page = browser.new_page();
        let Screen { width, height, ratio, is_touch, .. } = screen;
        for domain in ["Page", "Runtime", "Log", "Audits", "DOM"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        for script in [FINDER, KEEP_PICTURE, KEEP_WORDS] {
            page.call("Page.addScriptToEvaluateOnNewDocument", json!({"source": script}));
        }
        let size = json!({"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": is_touch});
        page.call("Emulation.setDeviceMetricsOverride", size);
        page.call("Emulation.setTouchEmulationEnabled", json!({"enabled": is_touch, "maxTouchPoints": 5}));
        page.call("Emulation.setFocusEmulationEnabled", json!({"enabled": true}));
        let theme = if screen.is_light { "light" } else { "dark" };
        let theme = json!({"features": [{"name": "prefers-color-scheme", "value": theme}]});
        page.call("Emulation.setEmulatedMedia", theme);
        Self { page, screen, forgiven: Vec::new() }
    }

    /// Opens the printed address, and reads what is shown first.
    pub fn sign_in(&mut self, server: &PageServer) {
        self.sign_in_with(server, &server.token.clone());
    }

    /// Opens the page with this token, and reads what is shown first.
    pub fn sign_in_with(&mut self, server: &PageServer, token: &str) {
        self.open(&format!("http://{}/#t={token}", server.host));
        self.wait("findByEye('.dialog button', 'Understood') !== null");
        self.tap(".dialog button", "Understood");
    }

    /// Opens an address.
    pub fn open(&mut self, address: &str) {
        // Another fragment alone would load nothing.
        self.page.call("Page.navigate", json!({"url": "about:blank"}));
        self.page.call("Page.navigate", json!({"url": address}));
    }

    /// Loads the page again.
    pub fn reload(&mut self) {
        self.page.call("Page.reload", json!({}));
    }

    /// The screen.
    #[must_use]
    pub fn screen(&self) -> Screen {
        self.screen
    }

    /// The connection to the page.
    pub fn page(&mut self) -> &mut DebuggingSocket {
        &mut self.page
    }

    /// Value of an expression of the page; promises are awaited.
    ///
    /// # Errors
    /// What it throws.
    pub fn try_evaluate(&mut self, expression: &str) -> Result<Value, String> {
        let call = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let mut answer = self.page.try_call("Runtime.evaluate", call)?;
        let thrown = &answer["exceptionDetails"];
        if !thrown.is_null() {
            return Err(format!("{expression}: {} {}", thrown["text"], thrown["exception"]["description"]));
        }
        Ok(answer["result"]["value"].take())
    }

    /// Value of an expression of the page; promises are awaited.
    ///
    /// # Panics
    /// Where it throws.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        self.try_evaluate(expression).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Waits until an expression of the page is true.
    ///
    /// # Panics
    /// Where it does not come to be.
    pub fn wait(&mut self, expression: &str) {
        let begun = Instant::now();
        // While a page is being loaded, nothing can be evaluated.
        while self.try_evaluate(expression) != Ok(Value::Bool(true)) {
            if begun.elapsed() > TIMEOUT {
                let seen = self.try_evaluate("document.body.innerText");
                let reported = &self.page.complaints;
                panic!("not so after {TIMEOUT:?}: {expression}\nreported: {reported:#?}\nshown: {seen:#?}");
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Text of the first element of this selector.
    pub fn text(&mut self, selector: &str) -> String {
        let text = self.evaluate(&format!("document.querySelector({})?.textContent ?? ''", json!(selector)));
        text.as_str().unwrap_or_default().to_owned()
    }

    /// Waits until the first element of this selector contains this text.
    pub fn wait_for_text(&mut self, selector: &str, text: &str) {
        let (selector, text) = (json!(selector), json!(text));
        self.wait(&format!("(document.querySelector({selector})?.textContent ?? '').includes({text})"));
    }

    /// Waits until the state line has, or has had since the last tap, key or word that was waited for, this word.
    pub fn wait_for_word(&mut self, word: &str) {
        self.wait(&format!("hasShownWord({})", json!(word)));
    }

    /// Forgets the words of the state line up to now.
    fn forget_words(&mut self) {
        let _ = self.try_evaluate("window.shownWords.length = 0; true");
    }

    /// Number of elements of this selector.
    pub fn count(&mut self, selector: &str) -> u64 {
        self.evaluate(&format!("document.querySelectorAll({}).length", json!(selector))).as_u64().unwrap_or_default()
    }

    /// Whether the first element of this selector and text is switched off.
    pub fn is_off(&mut self, selector: &str, text: &str) -> bool {
        self.evaluate(&format!("findByEye({}, {})?.isOff", json!(selector), json!(text))) != false
    }

    /// Where an element is, once it can be touched: in view, not switched off, and under nothing else.
    ///
    /// # Panics
    /// Where it cannot be touched.
    pub fn find(&mut self, selector: &str, text: &str) -> Spot {
        let begun = Instant::now();
        loop {
            let found = self.try_evaluate(&format!("findByEye({}, {})", json!(selector), json!(text)));
            let found = found.unwrap_or_default();
            if found["isFree"] == true && found["isOff"] == false {
                let number = |name: &str| found[name].as_f64().unwrap_or(f64::NAN);
                return Spot {
                    middle: (number("x"), number("y")),
                    corner: (number("left"), number("top")),
                    size: (number("width"), number("height")),
                };
            }
            if begun.elapsed() > TIMEOUT {
                self.picture("not-found");
                panic!("`{selector}` `{text}` cannot be touched: {found}\n{}", self.text("body"));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Middle of an element, also of one that is switched off.
    pub fn middle_of(&mut self, selector: &str) -> (f64, f64) {
        let found = self.evaluate(&format!("findByEye({}, '')", json!(selector)));
        (found["x"].as_f64().unwrap_or(f64::NAN), found["y"].as_f64().unwrap_or(f64::NAN))
    }

    /// Chooses a file for an input of files.
    pub fn choose_file(&mut self, selector: &str, path: &str) {
        let expression = format!("document.querySelector({})", json!(selector));
        let node = self.page.call("Runtime.evaluate", json!({"expression": expression}));
        let call = json!({"files": [path], "objectId": node["result"]["objectId"]});
        self.page.call("DOM.setFileInputFiles", call);
    }

    /// Number of pixels of the path's picture that have this colour, within a small difference.
    pub fn canvas_pixels(&mut self, colour: [u8; 3]) -> u64 {
        self.pixels_of("#path-canvas", colour)
    }

    /// Number of pixels of a canvas that have this colour, within a small difference.
    pub fn pixels_of(&mut self, canvas: &str, [red, green, blue]: [u8; 3]) -> u64 {
        let selector = json!(canvas);
        let count = format!(
            "(() => {{
               const canvas = document.querySelector({selector}), copy = document.createElement('canvas');
               [copy.width, copy.height] = [canvas.width, canvas.height];
               const context = copy.getContext('2d');
               context.drawImage(canvas, 0, 0);
               const pixels = context.getImageData(0, 0, copy.width, copy.height).data;
               const wanted = [{red}, {green}, {blue}];
               let count = 0;
               for (let at = 0; at < pixels.length; at += 4)
                 if (wanted.every((value, place) => Math.abs(pixels[at + place] - value) <= 8)) count++;
               return count;
             }})()"
        );
        self.evaluate(&count).as_u64().unwrap_or_default()
    }

    /// Number of pixels of the whole page, as it is on the screen, that are black.
    pub fn black_pixels(&mut self) -> u64 {
        let picture = self.page.call("Page.captureScreenshot", json!({"format": "png"}))["data"].take();
        let count = format!(
            "(async () => {{
               const bytes = Uint8Array.from(atob({picture}), letter => letter.charCodeAt(0));
               const bitmap = await createImageBitmap(new Blob([bytes]));
               const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
               context.drawImage(bitmap, 0, 0);
               const pixels = context.getImageData(0, 0, bitmap.width, bitmap.height).data;
               let count = 0;
               for (let at = 0; at < pixels.length; at += 4)
                 if (pixels[at] + pixels[at + 1] + pixels[at + 2] < 9) count++;
               return count;
             }})()"
        );
        self.evaluate(&count).as_u64().unwrap_or_default()
    }

    /// Waits until the number of pixels of this colour is right, for some seconds. Returns the last number.
    pub fn wait_for_pixels(&mut self, colour: [u8; 3], is_right: impl Fn(u64) -> bool) -> u64 {
        let begun = Instant::now();
        loop {
            let pixels = self.canvas_pixels(colour);
            if is_right(pixels) || begun.elapsed() > TIMEOUT {
                return pixels;
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Touches or clicks an element whose text or label begins with this. The finger is lifted without waiting for the
    /// page: held down for half a second, it would be no tap but a long press, which clicks nothing.
    pub fn tap(&mut self, selector: &str, text: &str) {
        let spot = self.find(selector, text);
        self.forget_words();
        let down = self.event("touchStart", "mousePressed", spot.middle);
        let up = self.event("touchEnd", "mouseReleased", spot.middle);
        self.page.call_in_a_row([down, up]);
    }

    /// Puts the finger, or presses the button of the mouse.
    pub fn press(&mut self, at: (f64, f64)) {
        self.forget_words();
        self.point("touchStart", "mousePressed", at);
    }

    /// Taps a place of the screen for 50 ms, as the time stamps of its events say.
    pub fn tap_at(&mut self, at: (f64, f64)) {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("a time after 1970").as_secs_f64();
        let [mut down, mut up] = [("touchStart", "mousePressed"), ("touchEnd", "mouseReleased")]
            .map(|(touch, mouse)| self.event(touch, mouse, at));
        (down.1["timestamp"], up.1["timestamp"]) = (json!(now - 0.05), json!(now));
        self.page.call_in_a_row([down, up]);
    }

    /// Moves the finger or the mouse that is down.
    pub fn move_to(&mut self, at: (f64, f64)) {
        self.point("touchMove", "mouseMoved", at);
    }

    /// Lifts the finger, or releases the button of the mouse.
    pub fn release(&mut self, at: (f64, f64)) {
        self.point("touchEnd", "mouseReleased", at);
    }

    /// Moves the finger that is down from here to there, as a hand does.
    pub fn drag(&mut self, from: (f64, f64), to: (f64, f64)) {
        for step in 1..=DRAG_STEPS {
            let share = f64::from(step) / f64::from(DRAG_STEPS);
            self.move_to((from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share));
        }
    }

    fn point(&mut self, touch: &str, mouse: &str, at: (f64, f64)) {
        let (method, event) = self.event(touch, mouse, at);
        self.page.call(method, event);
    }

    /// Call of an event of the finger or the mouse.
    fn event(&self, touch: &str, mouse: &str, (x, y): (f64, f64)) -> (&'static str, Value) {
        if self.screen.is_touch {
            let points = if touch == "touchEnd" { json!([]) } else { json!([{"x": x, "y": y}]) };
            ("Input.dispatchTouchEvent", json!({"type": touch, "touchPoints": points}))
        } else {
            let buttons = u32::from(mouse != "mouseReleased");
            let event = json!({"type": mouse, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
            ("Input.dispatchMouseEvent", event)
        }
    }

    /// Presses a key of the keyboard, named as `KeyboardEvent.key`, and does not let it go.
    pub fn key_down(&mut self, key: &str) {
        self.forget_words();
        let text = match key {
            "Enter" => "\r",
            key if key.chars().count() == 1 => key,
            _ => "",
        };
        let kind = if text.is_empty() { "rawKeyDown" } else { "keyDown" };
        let (code, number) = (code(key), number(key));
        let call = json!({"type": kind, "key": key, "code": code, "text": text, "windowsVirtualKeyCode": number});
        self.page.call("Input.dispatchKeyEvent", call);
    }

    /// Lets a key go.
    pub fn key_up(&mut self, key: &str) {
        let call = json!({"type": "keyUp", "key": key, "code": code(key), "windowsVirtualKeyCode": number(key)});
        self.page.call("Input.dispatchKeyEvent", call);
    }

    /// Presses a key and lets it go.
    pub fn key(&mut self, key: &str) {
        self.key_down(key);
        self.key_up(key);
    }

    /// Types a text.
    pub fn type_text(&mut self, text: &str) {
        text.chars().for_each(|character| self.key(&character.to_string()));
    }

    /// A picture of the page, as PNG.
    ///
    /// # Panics
    /// Where the browser makes none.
    pub fn png(&mut self) -> Vec<u8> {
        let picture = self.page.call("Page.captureScreenshot", json!({"format": "png"}));
        decode_base64(picture["data"].as_str().expect("a picture"))
    }

    /// Stores a picture in the folder that `RETRACE_PICTURES` names, to be looked at.
    pub fn picture(&mut self, name: &str) {
        if let Some(folder) = std::env::var_os("RETRACE_PICTURES") {
            let path = std::path::Path::new(&folder).join(format!("{name}.png"));
            let picture = self.png();
            std::fs::write(&path, picture).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
    }

    /// Takes back complaints that a test causes itself and that contain this text, also those that are still to come.
    pub fn forgive(&mut self, text: &str) {
        self.forgiven.push(text.to_owned());
    }
}

impl Drop for PageUser {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let said = self.try_evaluate("[document.querySelector('#message-line')?.textContent, shownWords].join()");
            println!("the page says: {said:?}");
            return;
        }
        let _ = self.try_evaluate("new Promise(resolve => setTimeout(resolve, 50))");
        let is_forgiven = |complaint: &String| self.forgiven.iter().any(|text| complaint.contains(text));
        let complaints: Vec<&String> =
            self.page.complaints.iter().filter(|complaint| !is_forgiven(complaint)).collect();
        assert!(complaints.is_empty(), "the page reports {complaints:#?}");
        self.page.post("Page.close", json!({}));
    }
}

/// `KeyboardEvent.code` of a key.
fn code(key: &str) -> String {
    match key {
        " " => "Space".into(),
        key if key.len() == 1 && key.as_bytes()[0].is_ascii_alphabetic() => format!("Key{}", key.to_ascii_uppercase()),
        key if key.len() == 1 && key.as_bytes()[0].is_ascii_digit() => format!("Digit{key}"),
        key if key.len() == 1 => String::new(),
        key => key.into(),
    }
}

/// Number of a key, by which browsers know the keys that write nothing.
fn number(key: &str) -> u32 {
    match key {
        "Enter" => 13,
        "Escape" => 27,
        " " => 32,
        "ArrowLeft" => 37,
        "ArrowUp" => 38,
        "ArrowRight" => 39,
        "ArrowDown" => 40,
        "Tab" => 9,
        key if key.len() == 1 && key.as_bytes()[0].is_ascii_alphanumeric() => {
            u32::from(key.as_bytes()[0].to_ascii_uppercase())
        }
        _ => 0,
    }
}

/// Bytes of a text in base 64.
fn decode_base64(text: &str) -> Vec<u8> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => Some(u32::from(byte - b'A')),
        b'a'..=b'z' => Some(u32::from(byte - b'a') + 26),
        b'0'..=b'9' => Some(u32::from(byte - b'0') + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    };
    let digits: Vec<u32> = text.bytes().filter_map(digit).collect();
    let bytes = |group: &[u32]| {
        let bits = group.iter().fold(0, |bits, digit| bits << 6 | digit) << (6 * (4 - group.len()));
        let [_, bytes @ ..] = bits.to_be_bytes();
        bytes.into_iter().take(group.len() - 1).collect::<Vec<u8>>()
    };
    digits.chunks(4).flat_map(bytes).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn base_64_is_read_with_and_without_padding() {
        let read = |text| String::from_utf8(super::decode_base64(text)).expect("a text");
        assert_eq!(read("cmV0cmFjZQ=="), "retrace");
        assert_eq!(read("cmV0cmFjZXI="), "retracer");
        assert_eq!(read("cmV0cmFjZXJz"), "retracers");
    }
}
