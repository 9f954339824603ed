//! Calls on `/v1/examples`.

use super::Api;
use crate::{args::SegmentsArg, error::ClientError, file};
use quadmuse_proto::{Example, ExampleId, ExamplePatch, Topology};
use reqwest::{Method, StatusCode};
use std::path::Path;

/// What an example is given along with its mesh.
#[derive(Clone, Debug, Default)]
pub struct ExampleUpload {
    /// Its name; that of its file if absent.
    pub name: Option<String>,
    /// Its tags.
    pub tags: Vec<String>,
    /// Its relevance, 0–5.
    pub relevance: Option<f64>,
    /// How it is cut into segments.
    pub segments: SegmentsArg,
}

/// An example after its upload.
#[derive(Clone, Debug)]
pub struct Added {
    /// The example.
    pub example: Example,
    /// Whether the corpus gained it, or had it already.
    pub how: Gain,
}

/// Whether an upload changed the corpus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gain {
    /// It was added.
    New,
    /// The same bytes and options were there already.
    AlreadyThere,
}

/// Which examples to list.
#[derive(Clone, Debug, Default)]
pub struct ExampleFilter {
    /// With all these tags.
    pub tags: Vec<String>,
    /// With a segment of this topology.
    pub topology: Option<Topology>,
}

impl Api {
    /// Adds a mesh file to the corpus.
    ///
    /// # Errors
    /// The file cannot be read, or the service refuses it or is out of reach.
    pub async fn add_example(&self, mesh: &Path, upload: &ExampleUpload) -> Result<Added, ClientError> {
        let name = upload.name.clone().unwrap_or_else(|| file::example_name(mesh));
        let mut query = vec![("name", name)];
        query.extend(upload.tags.iter().map(|tag| ("tag", tag.clone())));
        query.extend(upload.relevance.map(|relevance| ("relevance", relevance.to_string())));
        let request = self.request(Method::POST, &["examples"]).query(&query);
        let response = self.send_mesh(request, mesh, &upload.segments, &|_| ()).await?;
        let how = if response.status() == StatusCode::CREATED { Gain::New } else { Gain::AlreadyThere };
        let example = self.decode(response, "the example that was added").await?;
        Ok(Added { example, how })
    }

    /// All examples that pass the filter, page by page, in order of creation.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn examples(&self, filter: &ExampleFilter) -> Result<Vec<Example>, ClientError> {
        let tags = filter.tags.iter().map(|tag| ("tag", tag.clone()));
        let topology = filter.topology.map(|topology| ("topology", topology.to_string()));
        let fixed: Vec<(&str, String)> = tags.chain(topology).collect();
        self.pages(&["examples"], &fixed, "a page of examples").await
    }

    /// One example.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn example(&self, id: ExampleId) -> Result<Example, ClientError> {
        self.json(self.request(Method::GET, &["examples", &id.to_string()]), "an example").await
    }

    /// Changes an example's annotations.
    ///
    /// # Errors
    /// The service refuses or is out of reach.
    pub async fn patch_example(&self, id: ExampleId, patch: &ExamplePatch) -> Result<Example, ClientError> {
        let request = self.request(Method::PATCH, &["examples", &id.to_string()]).json(patch);
        self.json(request, "the example that was changed").await
    }

    /// Removes an example.
    ///
    /// # Errors
    /// The service refuses (there is none) or is out of reach.
    pub async fn remove_example(&self, id: ExampleId) -> Result<(), ClientError> {
        self.send(self.request(Method::DELETE, &["examples", &id.to_string()])).await.map(drop)
    }
}
