//! State of the server that all requests share: the desk, the sessions and the pages.
//!
//! Invariant: no lock of it is held while anything is waited for.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::extract::State;
use tokio::sync::watch;

use crate::control::Client;
use crate::host::ServeOptions;
use crate::identity::ServeIdentity;
use crate::operator_desk::OperatorDesk;
use crate::session::Sessions;
use crate::watched_folder::OfferView;

/// Maximum number of pages at a time.
pub(crate) const MAX_PAGES: usize = 16;

/// Longest name of a page, characters.
const MAX_PAGE_NAME: usize = 30;

/// The server, as handlers receive it.
pub(crate) type Shared = State<Arc<Server>>;

/// State of the server that all requests share.
pub(crate) struct Server {
    pub(crate) desk: OperatorDesk,
    pub(crate) options: ServeOptions,
    pub(crate) news: watch::Sender<u64>,
    pub(crate) receives_upload: Mutex<bool>,
    /// The last program that was offered, with its number.
    offer: Mutex<(u64, Option<OfferView>)>,
    /// Number that changes with the names of the pages.
    pub(crate) names_version: AtomicU64,
    identity: Arc<ServeIdentity>,
    pages: Mutex<Pages>,
    begun: Instant,
    /// Time of the last sign of life of the server's thread, ms since the beginning.
    alive_ms: AtomicU64,
}

#[derive(Debug, Default)]
struct Pages {
    last: Client,
    open: HashMap<Client, OpenPage>,
}

/// A page that is open.
#[derive(Debug)]
struct OpenPage {
    name: String,
    /// Credential of the session that opened it.
    credential: String,
}

impl Server {
    /// State of a server at this port, without pages.
    pub(crate) fn new(desk: OperatorDesk, identity: &Arc<ServeIdentity>, options: ServeOptions) -> Self {
        Self {
            desk,
            identity: Arc::clone(identity),
            news: watch::channel(0).0,
            receives_upload: Mutex::new(false),
            offer: Mutex::new((0, None)),
            names_version: AtomicU64::new(0),
            pages: Mutex::new(Pages::default()),
            begun: Instant::now(),
            alive_ms: AtomicU64::new(0),
            options,
        }
    }

    /// The server's thread is alive.
    pub(crate) fn show_life(&self) {
        self.alive_ms.store(self.begun.elapsed().as_millis() as u64, Ordering::Relaxed);
    }

    /// Time since the last sign of life of the server's thread.
    pub(crate) fn silence(&self) -> Duration {
        self.begun.elapsed().saturating_sub(Duration::from_millis(self.alive_ms.load(Ordering::Relaxed)))
    }

    pub(crate) fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.identity.sessions()
    }

    /// Number of the last offer, and the program.
    pub(crate) fn offer(&self) -> (u64, Option<OfferView>) {
        self.offer.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Offers a program on every page.
    pub(crate) fn set_offer(&self, offered: OfferView) {
        let mut offer = self.offer.lock().unwrap_or_else(PoisonError::into_inner);
        *offer = (offer.0 + 1, Some(offered));
        drop(offer);
        self.news.send_modify(|number| *number += 1);
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number for a new page of the session with this credential, if there is room for one.
    pub(crate) fn connect(&self, credential: String) -> Option<Client> {
        let mut pages = self.pages();
        if pages.open.len() >= MAX_PAGES {
            return None;
        }
        pages.last += 1;
        let client = pages.last;
        pages.open.insert(client, OpenPage { name: format!("page {client}"), credential });
        Some(client)
    }

    /// A page is gone.
    pub(crate) fn disconnect(&self, client: Client) {
        self.pages().open.remove(&client);
        self.desk.disconnect(client);
    }

    /// Name of a page; also of one that is gone.
    pub(crate) fn page_name(&self, client: Client) -> String {
        self.pages().open.get(&client).map_or_else(|| format!("page {client}"), |page| page.name.clone())
    }

    /// Whether the session with this credential has opened this page. A request by any other one does not speak for it.
    pub(crate) fn is_page_of(&self, client: Client, credential: Option<&str>) -> bool {
        self.pages().open.get(&client).is_some_and(|page| credential == Some(page.credential.as_str()))
    }

    /// Names a page.
    pub(crate) fn name_page(&self, client: Client, name: &str) {
        let name: String = name.trim().chars().filter(|c| !c.is_control()).take(MAX_PAGE_NAME).collect();
        if let (false, Some(page)) = (name.is_empty(), self.pages().open.get_mut(&client)) {
            page.name = name;
        }
        self.names_version.fetch_add(1, Ordering::Relaxed);
    }
}
