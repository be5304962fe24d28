//! Jobs that wait and are tried again, at a nats-server (SHP-9, SHP-18).

use std::fs;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;

use super::super::broker_connection::ANSWER_LIMIT;
use super::super::outbox::{Delivery, Outbox};
use super::super::{create_missing_stores, new_seed};
use super::*;
use crate::bundle::SourceFile;
use crate::content_hash::ContentHash;
use crate::job::tests::job;
use crate::machine_name::MachineName;

#[expect(unreachable_pub, reason = "it is shared with the end-to-end tests, of which it is a library")]
#[path = "../../../../../tests/src/not_run.rs"]
mod not_run;

const LIMITS: InboxLimits = InboxLimits { max_bytes: 1 << 20, disk_reserve_bytes: 0 };

const PART: &str = "G0 X1\nM2\n";

/// A server, the office and the machine of a shop; the office and the machine have one key.
struct Shop {
    root: tempfile::TempDir,
    program: PathBuf,
    port: u16,
    server: Option<Child>,
    settings: BrokerSettings,
    machine: MachineFolder,
    outbox: Outbox,
}

impl Drop for Shop {
    fn drop(&mut self) {
        self.kill_server();
    }
}

impl Shop {
    /// `None`, reported, where there is no nats-server.
    fn start(test: &str) -> Option<(Self, BrokerConnection)> {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders = std::env::split_paths(&path).chain([PathBuf::from("/usr/sbin")]);
        let Some(program) = folders.map(|folder| folder.join("nats-server")).find(|file| file.is_file()) else {
            not_run::not_run(&format!("shop::{test}"), "nats-server is not installed");
            return None;
        };
        let root = tempfile::tempdir().expect("a folder");
        let port =
            TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr()).expect("a port").port();
        let seed = root.path().join("seed");
        let submitters = BTreeMap::from([(new_seed(&seed).expect("a key"), "office".to_owned())]);
        let servers = vec![format!("nats://{}:{port}", Ipv4Addr::LOCALHOST)];
        let settings = BrokerSettings { servers, seed, ca: None, is_insecure: false, groups: Vec::new(), submitters };
        let machine = MachineFolder::of(root.path(), &MachineName::local());
        machine.create().expect("created");
        let outbox = Outbox::open(root.path()).expect("an outbox");
        let mut shop = Self { root, program, port, server: None, settings, machine, outbox };
        shop.start_server();
        let broker = BrokerConnection::begin(&shop.settings, "local").expect("begun");
        broker.wait(2 * ANSWER_LIMIT).expect("connected");
        create_missing_stores(&broker).expect("made");
        Some((shop, broker))
    }

    fn start_server(&mut self) {
        let mut command = Command::new(&self.program);
        command.args([
            "--addr",
            &Ipv4Addr::LOCALHOST.to_string(),
            "--port",
            &self.port.to_string(),
            "--jetstream",
            "--store_dir",
        ]);
        command.arg(self.root.path().join("store")).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        self.server = Some(command.spawn().expect("it runs"));
        let until = Instant::now() + 4 * ANSWER_LIMIT;
        while TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).is_err() {
            assert!(Instant::now() < until, "the server listens");
            sleep(Duration::from_millis(10));
        }
    }

    fn kill_server(&mut self) {
        if let Some(mut server) = self.server.take() {
            let _ = server.kill();
            let _ = server.wait();
        }
    }

    /// Receiver of the machine that tries a job again in every pass.
    fn receiver(&self) -> JobReceiver {
        let receiver = JobReceiver::new(self.machine.clone(), self.settings.clone(), LIMITS);
        JobReceiver { retry_interval: Duration::ZERO, ..receiver }
    }

    /// Submits a job, and sends it with its files.
    fn submit(&self, broker: &BrokerConnection, number: u64) -> ShopJobId {
        let path = self.root.path().join("part.ngc");
        fs::write(&path, PART).expect("a file");
        let sources = SourceFile::of_paths(&[path]).expect("names");
        let staged = self.outbox.stage(&sources, LIMITS).expect("staged");
        let job = job(number, staged.bundle().hash());
        self.outbox.submit(staged, &job).expect("submitted");
        assert!(matches!(self.outbox.deliver(broker, job.id), Ok(Some(Delivery::Sent))));
        job.id
    }
}

/// The broker has no files any more.
fn delete_files(broker: &BrokerConnection) {
    let stream = broker.stream("OBJ_programs").expect("a stream");
    broker.run(ANSWER_LIMIT, "a purge", async { stream.purge().await }).expect("purged");
}

/// Numbers of the errors, and names of the jobs that were received, in one pass that succeeds.
#[track_caller]
fn pass(receiver: &mut JobReceiver, broker: &BrokerConnection) -> Vec<String> {
    let mut news = Vec::new();
    receiver.pass(broker, &mut news).expect("the broker answers");
    let text = |one| match one {
        BrokerNews::Received(id, from) => format!("{id} from {from}"),
        BrokerNews::Refused(error) => error.number.to_owned(),
        other => panic!("{other:?}"),
    };
    news.into_iter().map(text).collect()
}

fn attempts(receiver: &JobReceiver) -> Vec<(ShopJobId, u32)> {
    receiver.waiting.iter().map(|(id, waiting)| (*id, waiting.attempts)).collect()
}

fn received(id: ShopJobId) -> String {
    format!("{id} from office")
}

/// Its message is read once over a connection: what waits is known to the receiver alone.
#[test]
fn a_waiting_job_stays_while_the_broker_does_not_answer_and_that_is_no_attempt() {
    let Some((shop, broker)) = Shop::start("a_waiting_job_stays_while_the_broker_does_not_answer") else { return };
    let mut receiver = shop.receiver();
    let first = shop.submit(&broker, 1);
    delete_files(&broker);
    for attempt in 1..MAX_ATTEMPTS {
        assert_eq!(pass(&mut receiver, &broker), [""; 0]);
        assert_eq!(attempts(&receiver), [(first, attempt)]);
    }
    // connected, and yet without answers to what a receiver asks
    let delete = async { broker.context().delete_stream("KV_claims").await };
    broker.run(ANSWER_LIMIT, "a deletion", delete).expect("deleted");
    for _ in 0..MAX_ATTEMPTS {
        let error = receiver.pass(&broker, &mut Vec::new()).expect_err("no claims");
        assert_eq!((error.number, attempts(&receiver)), ("E5035", vec![(first, MAX_ATTEMPTS - 1)]), "{error}");
    }
    create_missing_stores(&broker).expect("made");
    let second = shop.submit(&broker, 2);
    assert_eq!(pass(&mut receiver, &broker), [received(first), received(second)]);
    assert_eq!((attempts(&receiver), broker.connections()), (vec![], 1), "no message was read again");
}

#[test]
fn a_job_whose_files_never_come_is_refused_after_five_attempts() {
    let Some((shop, broker)) = Shop::start("a_job_whose_files_never_come_is_refused") else { return };
    let mut receiver = shop.receiver();
    let id = shop.submit(&broker, 1);
    delete_files(&broker);
    let said: Vec<Vec<String>> = (0..MAX_ATTEMPTS + 2).map(|_| pass(&mut receiver, &broker)).collect();
    let refused = said.iter().position(|said| said == &["E5006"]);
    assert_eq!((refused, said.concat().len()), (Some(MAX_ATTEMPTS as usize - 1), 1), "{said:?}");
    assert_eq!(attempts(&receiver), []);
    let ledger = Ledger::read(&shop.machine.ledger()).expect("whole");
    assert!(ledger.job(id).is_some_and(|job| job.is_refused && !job.is_taken));
    // its submitter learns it
    let settled = shop.outbox.deliver(&broker, id);
    assert!(
        matches!(&settled, Ok(Some(Delivery::Settled(claim))) if claim.state == ClaimState::Refused),
        "{settled:?}"
    );
}

/// With an agent that goes on, and with one that was killed meanwhile and has forgotten what waits.
#[test]
fn a_waiting_job_is_received_once_when_the_broker_is_back() {
    for is_killed in [false, true] {
        let test = "a_waiting_job_is_received_once_when_the_broker_is_back";
        let Some((mut shop, broker)) = Shop::start(test) else { return };
        let mut receiver = shop.receiver();
        let first = shop.submit(&broker, 1);
        delete_files(&broker);
        assert_eq!(pass(&mut receiver, &broker), [""; 0]);
        shop.kill_server();
        assert_eq!(receiver.pass(&broker, &mut Vec::new()).expect_err("away").number, "E5035");
        assert_eq!(attempts(&receiver), [(first, 1)]);
        if is_killed {
            receiver = shop.receiver();
        }
        shop.start_server();
        let until = Instant::now() + 8 * ANSWER_LIMIT;
        while broker.connections() < 2 || !broker.is_connected() {
            assert!(Instant::now() < until, "connected again");
            sleep(Duration::from_millis(20));
        }
        let second = shop.submit(&broker, 2);
        assert_eq!(pass(&mut receiver, &broker), [received(first), received(second)], "killed: {is_killed}");
        // nor does one that begins now receive them again
        assert_eq!(pass(&mut receiver, &broker), [""; 0]);
        assert_eq!(pass(&mut shop.receiver(), &broker), [""; 0]);
        assert_eq!(JobQueue::of(&shop.machine).ids(), Ok(vec![first, second]));
    }
}

/// The bundle is at the broker, and its file is not: what was loaded of it is deleted.
#[test]
fn a_job_that_waits_leaves_nothing_in_the_queue() {
    let Some((shop, broker)) = Shop::start("a_job_that_waits_leaves_nothing_in_the_queue") else { return };
    let first = shop.submit(&broker, 1);
    let objects = broker.objects("programs").expect("a store");
    let name = format!("sha256-{}", ContentHash::of(PART.as_bytes()));
    broker.run(ANSWER_LIMIT, "a deletion", objects.delete(&name)).expect("deleted");
    let mut receiver = shop.receiver();
    assert_eq!(pass(&mut receiver, &broker), [""; 0]);
    assert_eq!(attempts(&receiver), [(first, 1)]);
    let names = || -> Vec<String> {
        let entries = fs::read_dir(shop.machine.queue()).expect("a folder");
        entries.map(|entry| entry.expect("read").file_name().to_string_lossy().into_owned()).collect()
    };
    assert_eq!(names(), [""; 0]);
    let second = shop.submit(&broker, 2);
    assert_eq!(pass(&mut receiver, &broker), [received(first), received(second)]);
    let mut found = names();
    found.sort();
    assert_eq!(found, [first.to_string(), second.to_string()]);
}
