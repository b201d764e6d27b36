//! A link that can be made bad: a TCP proxy on loopback that delays, bounds the speed, cuts, resets and stalls.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};

const PIECE: usize = 8 << 10;

/// What happens to a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// None.
    No,
    /// Both ends see the connection close.
    Cut,
    /// Both ends see it reset.
    Reset,
    /// Nothing moves any more, and nobody is told.
    Stall,
}

/// How the link is.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    pub bytes_per_second: f64,
    /// One way.
    pub delay: Duration,
}

struct Shared {
    link: Link,
    /// When the next byte may go up: all connections share the link.
    next_up: Mutex<Instant>,
    connections: Mutex<HashMap<u64, watch::Sender<Trouble>>>,
    up_bytes: AtomicU64,
}

/// A proxy in a thread of its own; ends with the process.
pub struct Proxy {
    pub url: String,
    shared: Arc<Shared>,
    rng: ChaCha8Rng,
}

impl Proxy {
    /// Before the service at `target` (`http://host:port`).
    pub fn start(target: &str, link: Link, seed: u64) -> Self {
        let target = target.strip_prefix("http://").unwrap().to_owned();
        let shared = Arc::new(Shared {
            link,
            next_up: Mutex::new(Instant::now()),
            connections: Mutex::default(),
            up_bytes: AtomicU64::new(0),
        });
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let serving = shared.clone();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let listener = TcpListener::from_std(listener).unwrap();
                for number in 0.. {
                    let (client, _) = listener.accept().await.unwrap();
                    tokio::spawn(connection(client, target.clone(), serving.clone(), number));
                }
            });
        });
        Self { url, shared, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// Bytes that clients have sent so far.
    pub fn up_bytes(&self) -> u64 {
        self.shared.up_bytes.load(Ordering::SeqCst)
    }

    /// Troubles a connection at random. False when there is none that is still well.
    pub fn strike(&mut self, trouble: Trouble) -> bool {
        let connections = self.shared.connections.lock().unwrap();
        let mut well: Vec<_> = connections.iter().filter(|(_, state)| *state.borrow() == Trouble::No).collect();
        well.sort_by_key(|(number, _)| **number);
        if well.is_empty() {
            return false;
        }
        well[self.rng.random_range(0..well.len())].1.send_replace(trouble);
        true
    }
}

async fn connection(client: TcpStream, target: String, shared: Arc<Shared>, number: u64) {
    let Ok(server) = TcpStream::connect(&target).await else { return };
    let (sender, mut trouble) = watch::channel(Trouble::No);
    shared.connections.lock().unwrap().insert(number, sender);
    let ((from_client, to_client), (from_server, to_server)) = (client.into_split(), server.into_split());
    let (stalled_up, stalled_down) = (trouble.clone(), trouble.clone());
    let up = {
        let shared = shared.clone();
        async move { pump(from_client, to_server, &shared, true, stalled_up).await }
    };
    let down = {
        let shared = shared.clone();
        async move { pump(from_server, to_client, &shared, false, stalled_down).await }
    };
    let (up, down) = (tokio::spawn(up), tokio::spawn(down));
    let (up_end, down_end) = (up.abort_handle(), down.abort_handle());
    let ended = async {
        let how = trouble.wait_for(|t| matches!(t, Trouble::Cut | Trouble::Reset)).await.map_or(Trouble::Cut, |t| *t);
        if how == Trouble::Reset {
            tokio::time::sleep(Duration::from_millis(50)).await; // both pumps make their ends ready to be reset
        }
    };
    tokio::select! {
        () = ended => {}
        _ = up => {}
        _ = down => {}
    }
    let state = shared.connections.lock().unwrap().remove(&number);
    if state.is_some_and(|state| *state.borrow() == Trouble::Stall) {
        tokio::time::sleep(Duration::from_secs(300)).await; // nobody hears that the other side has gone
    }
    up_end.abort();
    down_end.abort();
}

/// Moves bytes with the delay and the speed of the link. Ends when either side does, or the connection is troubled.
async fn pump(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    shared: &Shared,
    up: bool,
    trouble: watch::Receiver<Trouble>,
) {
    // The link holds what is under way, so the sender feels its delay and its speed.
    let (sender, mut receiver) = mpsc::channel::<(Instant, Vec<u8>)>(64);
    let mut stalled = trouble.clone();
    let read = async move {
        let mut piece = vec![0; PIECE];
        loop {
            let n = tokio::select! {
                read = from.read(&mut piece) => read.unwrap_or(0),
                () = becomes(&mut stalled, Trouble::Stall) => std::future::pending().await,
            };
            if n == 0 {
                return;
            }
            let mut arrives = Instant::now();
            if up {
                shared.up_bytes.fetch_add(n as u64, Ordering::SeqCst);
                let mut next = shared.next_up.lock().unwrap();
                *next = (*next).max(arrives) + Duration::from_secs_f64(n as f64 / shared.link.bytes_per_second);
                arrives = *next;
            }
            if up {
                tokio::time::sleep_until(arrives.into()).await;
            }
            if sender.send((arrives + shared.link.delay, piece[..n].to_vec())).await.is_err() {
                return;
            }
        }
    };
    let write = async {
        while let Some((arrives, piece)) = receiver.recv().await {
            tokio::time::sleep_until(arrives.into()).await;
            let now = *trouble.borrow();
            match now {
                Trouble::Stall => std::future::pending().await,
                Trouble::Reset => return,
                Trouble::No | Trouble::Cut => {}
            }
            if to.write_all(&piece).await.is_err() {
                return;
            }
        }
    };
    let mut resets = trouble.clone();
    let was_reset = tokio::select! {
        // What was read before the end still arrives, unless the connection is cut.
        ((), ()) = async { tokio::join!(read, write) } => false,
        () = becomes(&mut resets, Trouble::Reset) => true,
    };
    if was_reset {
        let _ = to.as_ref().set_zero_linger();
        std::future::pending::<()>().await; // the connection ends when both directions are ready
    }
}

/// Waits until this trouble comes; for ever if it cannot any more.
async fn becomes(trouble: &mut watch::Receiver<Trouble>, what: Trouble) {
    if trouble.wait_for(|now| *now == what).await.is_err() {
        std::future::pending().await
    }
}
