//! Calls on `/v1/queries`: queries, their rankings, maps, compositions and retopologies.

use super::{Api, Sent, WORK_TIMEOUT};
use crate::{
    args::{QueryArgs, SizeArgs},
    error::ClientError,
    stream::StreamFormat,
};
use quadmuse_proto::{
    Composition, CompositionId, ConstraintEdit, ExampleId, Making, MakingState, Map, MapId, MeshFormat, NewComposition,
    NewMap, NewRetopo, Page, Query, QueryId, QueryPatch, Ranking, Retopo,
};
use reqwest::{Method, RequestBuilder, Response, header};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::time::Duration;

/// Side of a picture of a result, in pixels: the most that the service draws.
pub(super) const PICTURE_SIDE: u32 = 1024;

/// What a long poll may take beyond its waiting time.
const POLL_SLACK: Duration = Duration::from_secs(30);

/// Asks the service to hold its answer until it is done, as long as it will: until then it cancels the work when this program ends.
const WAIT: [(&str, &str); 1] = [("wait", "240")];

/// Something that is made of a query, or how far it is.
#[derive(Deserialize)]
#[serde(untagged)]
enum Made<T> {
    There(Box<T>),
    Making(Making),
}

/// The id of what is still being made, to ask for it again.
///
/// # Errors
/// It failed, or was cancelled.
fn going_on(making: Making) -> Result<String, ClientError> {
    match (making.state, making.problem) {
        (MakingState::Cancelled, _) => {
            Err(ClientError::MakingCancelled { product: making.product.as_str(), id: making.id })
        }
        (_, Some(problem)) => Err(ClientError::Refused(Box::new(problem))),
        (MakingState::Queued | MakingState::Running | MakingState::Done | MakingState::Failed, None) => Ok(making.id),
    }
}

/// Which ranking is asked for.
#[derive(Clone, Copy, Debug)]
pub struct RankingView {
    /// The query's segment.
    pub segment: u32,
    /// Wait for a revision after this one.
    pub after: Option<u64>,
    /// For so long at most, in milliseconds.
    pub wait_ms: u64,
}

/// The size of a mesh that was asked for in another size than its own.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Resized {
    /// Its faces.
    pub faces: u64,
    /// The distance that 95 % of it and of the scan have from each other at most, in % of the scan's diagonal.
    pub within_percent: f64,
}

/// Where a mesh is downloaded from.
#[derive(Clone, Copy, Debug)]
pub enum MeshSource {
    /// The mesh of a map.
    Map(MapId),
    /// The mesh of a composition.
    Composition(CompositionId),
}

impl Api {
    /// Uploads a mesh to be ranked, cut `like` an example is if one is told; `sent` hears how much of it has arrived.
    ///
    /// # Errors
    /// The file cannot be read, or the service refuses it or is out of reach.
    pub async fn start_query(
        &self,
        args: &QueryArgs,
        like: Option<ExampleId>,
        sent: Sent<'_>,
    ) -> Result<Query, ClientError> {
        let rank = &args.rank;
        let mut query: Vec<(&str, String)> = rank.tags.iter().map(|tag| ("tag", tag.clone())).collect();
        query.extend(rank.top.map(|top| ("top", top.to_string())));
        query.extend(rank.resolution.map(|resolution| ("resolution", resolution.to_string())));
        query.extend(rank.deadline.map(|seconds| ("deadline_ms", format!("{:.0}", (seconds * 1000.0).ceil()))));
        query.extend(like.map(|example| ("like", example.to_string())));
        let request = self.request(Method::POST, &["queries"]).query(&query);
        let response = self.send_mesh(request, &args.file, &rank.segments, sent).await?;
        self.decode(response, "the query that was started").await
    }

    /// Starts a query again from what the service keeps of it: another query, with an id of its own.
    ///
    /// # Errors
    /// The service refuses (it keeps nothing of it) or is out of reach.
    pub async fn restart_query(&self, id: QueryId) -> Result<Query, ClientError> {
        self.json(self.request(Method::POST, &["queries", &id.to_string(), "restart"]), "the query that was started")
            .await
    }

    /// A query as it stands.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn query(&self, id: QueryId) -> Result<Query, ClientError> {
        self.json(self.request(Method::GET, &["queries", &id.to_string()]), "a query").await
    }

    /// Names segments of a query.
    ///
    /// # Errors
    /// The service refuses (there is no such segment) or is out of reach.
    pub async fn patch_query(&self, id: QueryId, patch: &QueryPatch) -> Result<Query, ClientError> {
        let request = self.request(Method::PATCH, &["queries", &id.to_string()]).json(patch);
        self.json(request, "the query that was changed").await
    }

    /// The address of the service's page that shows a query.
    pub fn page(&self, id: QueryId) -> String {
        format!("{}/#{id}", self.server())
    }

    /// The caller's queries that the service holds.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn queries(&self) -> Result<Vec<Query>, ClientError> {
        self.pages(&["queries"], &[], "a page of queries").await
    }

    /// The maps of a query.
    ///
    /// # Errors
    /// The service refuses (there is no such query) or is out of reach.
    pub async fn maps(&self, id: QueryId) -> Result<Vec<Map>, ClientError> {
        let request = self.request(Method::GET, &["queries", &id.to_string(), "maps"]);
        let page: Page<Map> = self.json(request, "a page of maps").await?;
        Ok(page.items)
    }

    /// A map that is there.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn map(&self, id: QueryId, map: MapId) -> Result<Map, ClientError> {
        self.json(self.request(Method::GET, &["queries", &id.to_string(), "maps", &map.to_string()]), "a map").await
    }

    /// The ranking of one segment of a query, at once or when it is newer.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn ranking(&self, id: QueryId, view: RankingView) -> Result<Ranking, ClientError> {
        let mut query = vec![("segment", view.segment.to_string())];
        if let Some(after) = view.after {
            query.push(("after", after.to_string()));
            query.push(("wait_ms", view.wait_ms.to_string()));
        }
        let request = self.request(Method::GET, &["queries", &id.to_string(), "ranking"]).query(&query);
        self.json(request.timeout(Duration::from_millis(view.wait_ms) + POLL_SLACK), "a ranking").await
    }

    /// Opens the stream of a query's rankings, after an event already seen.
    ///
    /// # Errors
    /// The service refuses or is out of reach, or answers with no stream.
    pub async fn ranking_stream(
        &self,
        id: QueryId,
        after: Option<u64>,
    ) -> Result<(StreamFormat, Response), ClientError> {
        let request = self.request(Method::GET, &["queries", &id.to_string(), "stream"]);
        let mut request = request.timeout(WORK_TIMEOUT).header(header::ACCEPT, StreamFormat::ACCEPT);
        if let Some(after) = after {
            request = request.header("last-event-id", after.to_string());
        }
        let response = self.send(request).await?;
        let media_type = response.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
        match media_type.and_then(StreamFormat::from_media_type) {
            Some(format) => Ok((format, response)),
            None => Err(ClientError::Unintelligible {
                url: response.url().to_string(),
                expected: "a stream of events",
                found: format!("`{}`", media_type.unwrap_or_default()),
            }),
        }
    }

    /// Lays an example on a segment of a query.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn start_map(&self, id: QueryId, new: &NewMap) -> Result<Map, ClientError> {
        self.made((id, "maps"), new, "a map").await
    }

    /// Edits the constraints of a map.
    ///
    /// # Errors
    /// The service refuses (an edit may fold the map) or is out of reach.
    pub async fn edit_constraints(&self, id: QueryId, map: MapId, edit: &ConstraintEdit) -> Result<Map, ClientError> {
        let path = ["queries", &id.to_string(), "maps", &map.to_string(), "constraints"];
        let request = self.request(Method::PATCH, &path).json(edit);
        self.json(request.timeout(WORK_TIMEOUT), "the map that was edited").await
    }

    /// Stitches maps.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn start_composition(&self, id: QueryId, new: &NewComposition) -> Result<Composition, ClientError> {
        self.made((id, "compositions"), new, "a composition").await
    }

    /// Makes quads for all of a query's scan.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn start_retopo(&self, id: QueryId, new: &NewRetopo) -> Result<Retopo, ClientError> {
        self.made((id, "retopos"), new, "a retopology").await
    }

    /// Has the service make something of a query, and waits until it is there.
    async fn made<T: DeserializeOwned>(
        &self,
        (query, kind): (QueryId, &str),
        new: &impl Serialize,
        what: &'static str,
    ) -> Result<T, ClientError> {
        let path = ["queries", &query.to_string(), kind];
        let request = self.request(Method::POST, &path).query(&WAIT).json(new);
        let mut found: Made<T> = self.json(request.timeout(WORK_TIMEOUT), what).await?;
        loop {
            let making = match found {
                Made::There(there) => return Ok(*there),
                Made::Making(making) => going_on(making)?,
            };
            let path = [path[0], path[1], path[2], &making];
            let _unfinished = self.unfinished.hold(&path);
            let request = self.request(Method::GET, &path).query(&WAIT);
            found = self.json(request.timeout(WORK_TIMEOUT), what).await?;
        }
    }

    /// A composition that is there.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn composition(&self, id: QueryId, composition: CompositionId) -> Result<Composition, ClientError> {
        let path = ["queries", &id.to_string(), "compositions", &composition.to_string()];
        self.json(self.request(Method::GET, &path), "a composition").await
    }

    /// Downloads a mesh, in the size that is wanted.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn mesh(
        &self,
        id: QueryId,
        source: MeshSource,
        format: MeshFormat,
        size: &SizeArgs,
    ) -> Result<(Vec<u8>, Option<Resized>), ClientError> {
        let mut request = self.of_source(id, source, "mesh").query(&[("format", format.as_str())]);
        if let Some(quads) = size.quads {
            request = request.query(&[("quads", quads)]);
        }
        if let Some(tolerance) = size.tolerance {
            request = request.query(&[("tolerance", tolerance)]);
        }
        let response = self.send(request.timeout(WORK_TIMEOUT)).await?;
        let header = |name: &str| response.headers().get(name)?.to_str().ok();
        let faces = header("quadmuse-faces").and_then(|faces| faces.parse().ok());
        let within = header("quadmuse-within").and_then(|within| within.parse().ok());
        let sized = faces.zip(within).map(|(faces, within_percent)| Resized { faces, within_percent });
        Ok((response.bytes().await.map_err(|source| self.broken(source, 0))?.to_vec(), sized))
    }

    /// Downloads a shaded picture of a mesh, with its quads: a PNG of 1024² pixels.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn picture(&self, id: QueryId, source: MeshSource) -> Result<Vec<u8>, ClientError> {
        self.bytes(self.of_source(id, source, "preview.png").query(&[("size", PICTURE_SIDE)])).await
    }

    /// A request for what belongs to a map or a composition.
    fn of_source(&self, id: QueryId, source: MeshSource, what: &str) -> RequestBuilder {
        let (kind, of) = match source {
            MeshSource::Map(map) => ("maps", map.to_string()),
            MeshSource::Composition(composition) => ("compositions", composition.to_string()),
        };
        self.request(Method::GET, &["queries", &id.to_string(), kind, &of, what])
    }
}
