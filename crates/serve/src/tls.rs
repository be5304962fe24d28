//! TLS: the certificate that the user gives, and connections that are encrypted with it.
//!
//! Invariant: the handshake is part of a connection's first read or write, so that nobody who is slow in it delays
//! anybody else; the limits of the connection below hold for it too.

use std::future::Future as _;
use std::io;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use retrace_config::NumberedError;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{ServerConfig, crypto::ring};
use tokio_rustls::server::TlsStream;
use tokio_rustls::{Accept, TlsAcceptor};

/// Files of the certificate and of its private key, in PEM.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// Certificate, and those of the authorities between it and the one that browsers know.
    pub certificate: PathBuf,
    /// Private key.
    pub key: PathBuf,
}

impl TlsFiles {
    /// Reads both files.
    ///
    /// # Errors
    /// `E2427` where a file cannot be read; `E2428` where the key is not that of the certificate.
    pub(crate) fn acceptor(&self) -> Result<TlsAcceptor, NumberedError> {
        let unreadable = |path: &PathBuf, what: &str, error: &dyn std::fmt::Display| {
            let cause = format!("--tls: {}: {what} cannot be read: {error}", path.display());
            NumberedError::new("E2427", cause, "give a certificate and its private key as PEM files: --tls CERT KEY")
        };
        let no_certificate = |error: &dyn std::fmt::Display| unreadable(&self.certificate, "the certificate", error);
        let certificates: Vec<CertificateDer<'static>> = CertificateDer::pem_file_iter(&self.certificate)
            .and_then(Iterator::collect)
            .map_err(|error| no_certificate(&error))?;
        if certificates.is_empty() {
            return Err(no_certificate(&"the file has no certificate"));
        }
        let key = PrivateKeyDer::from_pem_file(&self.key);
        let key = key.map_err(|error| unreadable(&self.key, "the private key", &error))?;
        let refused = |error: tokio_rustls::rustls::Error| {
            let (certificate, key) = (self.certificate.display(), self.key.display());
            let cause = format!("--tls: {key} is not the key of the certificate {certificate}: {error}");
            NumberedError::new("E2428", cause, "give the private key that the certificate was made for")
        };
        let provider = Arc::new(ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        let config = config.map_err(refused)?.with_no_client_auth();
        let mut config = config.with_single_cert(certificates, key).map_err(refused)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(TlsAcceptor::from(Arc::new(config)))
    }
}

/// A connection that may be encrypted.
pub(crate) enum MaybeTls<C> {
    /// It is not.
    Plain(C),
    /// Its handshake is not done.
    Handshake(Box<Accept<C>>),
    /// It is.
    Encrypted(Box<TlsStream<C>>),
    /// Its handshake has failed.
    Failed,
}

impl<C: AsyncRead + AsyncWrite + Unpin> MaybeTls<C> {
    /// A connection, encrypted where there is an acceptor.
    pub(crate) fn new(connection: C, acceptor: Option<&TlsAcceptor>) -> Self {
        match acceptor {
            Some(acceptor) => Self::Handshake(Box::new(acceptor.accept(connection))),
            None => Self::Plain(connection),
        }
    }

    /// Goes on with the handshake.
    fn poll_handshake(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        if let Self::Handshake(accept) = self {
            // A handshake that has ended must not be polled again.
            let (next, result) = match ready!(Pin::new(accept.as_mut()).poll(context)) {
                Ok(stream) => (Self::Encrypted(Box::new(stream)), Ok(())),
                Err(error) => (Self::Failed, Err(error)),
            };
            *self = next;
            return Poll::Ready(result);
        }
        Poll::Ready(Ok(()))
    }

    /// Does something with the stream, once the handshake is done.
    fn poll_with<T>(
        &mut self,
        context: &mut Context<'_>,
        poll: impl FnOnce(Pin<&mut dyn AsyncStream>, &mut Context<'_>) -> Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        ready!(self.poll_handshake(context))?;
        match self {
            Self::Plain(stream) => poll(Pin::new(stream), context),
            Self::Encrypted(stream) => poll(Pin::new(stream.as_mut()), context),
            Self::Handshake(_) => Poll::Pending,
            Self::Failed => Poll::Ready(Err(io::ErrorKind::NotConnected.into())),
        }
    }
}

/// A stream in both directions.
trait AsyncStream: AsyncRead + AsyncWrite + Unpin {}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncStream for S {}

impl<C: AsyncRead + AsyncWrite + Unpin> AsyncRead for MaybeTls<C> {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        self.poll_with(context, |stream, context| stream.poll_read(context, into))
    }
}

impl<C: AsyncRead + AsyncWrite + Unpin> AsyncWrite for MaybeTls<C> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.poll_with(context, |stream, context| stream.poll_write(context, bytes))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.poll_with(context, |stream, context| stream.poll_write_vectored(context, slices))
    }

    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.poll_with(context, |stream, context| stream.poll_flush(context))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        // A connection whose handshake was never done has nothing to end.
        if matches!(*self, Self::Handshake(_) | Self::Failed) {
            return Poll::Ready(Ok(()));
        }
        self.poll_with(context, |stream, context| stream.poll_shutdown(context))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    #[test]
    fn a_handshake_that_fails_is_an_error_however_often_it_is_read() {
        let files =
            |name: &str| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/tls/")).join(name);
        let tls = TlsFiles { certificate: files("certificate.pem"), key: files("key.pem") };
        let acceptor = tls.acceptor().expect("a certificate and its key");
        let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
        runtime.block_on(async {
            let (mut client, server) = tokio::io::duplex(1024);
            client.write_all(b"GET / HTTP/1.1\r\nhost: x\r\n\r\n").await.expect("it is written");
            let mut connection = MaybeTls::new(server, Some(&acceptor));
            for _ in 0..3 {
                assert!(connection.read(&mut [0; 16]).await.is_err());
                assert!(connection.write(b"x").await.is_err());
            }
            connection.shutdown().await.expect("nothing to end");
        });
    }
}
