//! Connections with limits: of their number, and of the time in which nothing comes of them.
//!
//! Invariant: whoever opens connections and sends nothing, or a byte now and then, holds each of them for
//! [`SILENCE_TIMEOUT`] only, and never more than [`MAX_CONNECTIONS`] of them.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep_until};
use tokio_rustls::TlsAcceptor;

use crate::tls::MaybeTls;

/// Maximum number of connections at a time.
const MAX_CONNECTIONS: usize = 128;

/// Time in which the server must have had a reason to answer, or a good piece of an upload must have come.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(10);

/// Number of bytes of an upload that count as progress.
const PROGRESS: usize = 16 << 10;

/// Delay after an error of the system, such as too many open files.
const ERROR_DELAY: Duration = Duration::from_millis(100);

/// Listener of connections with limits.
pub(crate) struct BoundedListener {
    listener: TcpListener,
    tls: Option<TlsAcceptor>,
    permits: Arc<Semaphore>,
}

impl BoundedListener {
    /// Bounds the connections of this listener, which are encrypted where there is an acceptor.
    pub(crate) fn new(listener: TcpListener, tls: Option<TlsAcceptor>) -> Self {
        Self { listener, tls, permits: Arc::new(Semaphore::new(MAX_CONNECTIONS)) }
    }
}

impl Listener for BoundedListener {
    type Io = MaybeTls<BoundedConnection>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, SocketAddr) {
        loop {
            // The semaphore is never closed; without a permit the connection is bounded by its time alone.
            let permit = Arc::clone(&self.permits).acquire_owned().await.ok();
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    let _ = stream.set_nodelay(true);
                    let connection = BoundedConnection::new(stream, permit);
                    return (MaybeTls::new(connection, self.tls.as_ref()), address);
                }
                Err(_) => tokio::time::sleep(ERROR_DELAY).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Address of the other end of a connection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peer(pub(crate) SocketAddr);

impl Connected<IncomingStream<'_, BoundedListener>> for Peer {
    fn connect_info(stream: IncomingStream<'_, BoundedListener>) -> Self {
        Self(*stream.remote_addr())
    }
}

/// A connection that ends where nothing comes of it.
pub(crate) struct BoundedConnection {
    stream: TcpStream,
    deadline: Pin<Box<Sleep>>,
    /// Bytes that were read since the deadline was set.
    read: usize,
    _permit: Option<OwnedSemaphorePermit>,
}

impl BoundedConnection {
    fn new(stream: TcpStream, permit: Option<OwnedSemaphorePermit>) -> Self {
        let deadline = Box::pin(sleep_until(Instant::now() + SILENCE_TIMEOUT));
        Self { stream, deadline, read: 0, _permit: permit }
    }

    fn extend(&mut self) {
        self.read = 0;
        self.deadline.as_mut().reset(Instant::now() + SILENCE_TIMEOUT);
    }
}

impl AsyncRead for BoundedConnection {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = into.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, into);
        self.read += into.filled().len() - before;
        if self.read >= PROGRESS {
            self.extend();
        }
        // A byte now and then does not hold the connection either.
        if self.deadline.as_mut().poll(context).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for BoundedConnection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        if matches!(written, Poll::Ready(Ok(1..))) {
            self.extend();
        }
        written
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        if matches!(written, Poll::Ready(Ok(1..))) {
            self.extend();
        }
        written
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
