//! Web page of an ATI Net F/T, which states the counts of its forces. Its elements are those that public clients read: `cfgcpf` and
//! `scfgfu` of netftapi2.xml, the active configuration (manual of the Ethernet Axia, table 11.2).

use palpate_link::time::timeout;
use palpate_link::wire::Connector;
use std::io;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Port of the page.
pub const PAGE_PORT: u16 = 80;

/// Longest wait for the page.
const PAGE_DEADLINE: Duration = Duration::from_secs(2);

/// Largest number of bytes of the page. That of a device has some 6000.
const PAGE_BYTES: u64 = 65_536;

/// Scale of the forces, as the page states it.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceCounts {
    /// Counts per unit.
    pub counts: f64,
    /// The unit, such as `N` or `lbf`.
    pub unit: String,
}

impl ForceCounts {
    /// Asks for the page behind a link.
    ///
    /// # Errors
    /// What went wrong, in words: no answer in time, or another page.
    pub async fn ask(page: &Connector) -> Result<ForceCounts, String> {
        let page = timeout(PAGE_DEADLINE, read(page)).await;
        let page = page.map_err(|_| format!("no answer within {} s", PAGE_DEADLINE.as_secs()))?;
        let page = page.map_err(|error| error.to_string())?;
        let counts = element(&page, "cfgcpf").and_then(|text| text.parse().ok());
        let counts = counts.filter(|counts: &f64| counts.is_finite()).ok_or("the answer has no number `cfgcpf`")?;
        Ok(ForceCounts { counts, unit: element(&page, "scfgfu").unwrap_or("N").to_owned() })
    }
}

async fn read(page: &Connector) -> io::Result<String> {
    let mut stream = page.open().await?;
    stream.write_all(b"GET /netftapi2.xml HTTP/1.0\r\n\r\n").await?;
    let mut bytes = Vec::new();
    stream.take(PAGE_BYTES).read_to_end(&mut bytes).await?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn element<'p>(page: &'p str, name: &str) -> Option<&'p str> {
    let (_, rest) = page.split_once(&format!("<{name}>"))?;
    rest.split_once("</").map(|(text, _)| text.trim())
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_link::wire::Link;
    use tokio::net::TcpListener;

    /// Serves an answer to one client, or none.
    async fn asked(answer: Option<&'static str>) -> Result<ForceCounts, String> {
        let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = server.local_addr().unwrap().port();
        let served = tokio::spawn(async move {
            let (mut client, _) = server.accept().await.unwrap();
            let mut request = [0; 31];
            client.read_exact(&mut request).await.unwrap();
            assert_eq!(request, *b"GET /netftapi2.xml HTTP/1.0\r\n\r\n");
            match answer {
                Some(answer) => client.write_all(answer.as_bytes()).await.unwrap(),
                None => std::future::pending().await,
            }
        });
        let page = Connector::Real(Link::Tcp { host: "127.0.0.1".to_owned(), port });
        let counts = ForceCounts::ask(&page).await;
        served.abort();
        counts
    }

    #[tokio::test]
    async fn counts_and_unit_are_read_and_another_page_or_none_is_named() {
        let counts = |counts, unit: &str| Ok(ForceCounts { counts, unit: unit.to_owned() });
        let page = "HTTP/1.0 200 OK\r\n\r\n<?xml version=\"1.0\"?><netft><scfgfu>lbf</scfgfu><cfgcpf> 500000 </cfgcpf></netft>";
        assert_eq!(asked(Some(page)).await, counts(5e5, "lbf"));
        assert_eq!(asked(Some("<cfgcpf>1000000</cfgcpf>")).await, counts(1e6, "N"));
        for other in
            ["HTTP/1.0 404 Not Found\r\n\r\n", "<cfgcpf>many</cfgcpf>", "<cfgcpf>1", "<cfgcpf>inf</cfgcpf>", ""]
        {
            assert_eq!(asked(Some(other)).await.unwrap_err(), "the answer has no number `cfgcpf`", "{other}");
        }
        assert_eq!(asked(None).await.unwrap_err(), "no answer within 2 s");
    }
}
