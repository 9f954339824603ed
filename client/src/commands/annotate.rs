//! `annotate`: what is known of an example beside its mesh.

use super::corpus::print;
use crate::{api::Api, args::AnnotateArgs, error::ClientError, names, spec::Landmarks, ui::Ui};
use quadmuse_proto::{ExampleId, ExamplePatch, NamedPoint};

pub(super) async fn annotate(args: &AnnotateArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let given = args.landmarks.as_deref().map(Landmarks::read_of_example).transpose()?;
    let id = names::example(&args.id, api).await?;
    let patch = ExamplePatch {
        name: args.name.clone(),
        author: args.author.clone(),
        licence: args.licence.clone(),
        notes: args.notes.clone(),
        landmarks: landmarks(args, given, id, api).await?,
        ..ExamplePatch::default()
    };
    print(&api.patch_example(id, &patch).await?, ui)
}

/// All landmarks that the example is to have; `None` where they stay.
async fn landmarks(
    args: &AnnotateArgs,
    given: Option<Vec<NamedPoint>>,
    id: ExampleId,
    api: &Api,
) -> Result<Option<Vec<NamedPoint>>, ClientError> {
    if args.landmark.is_empty() && args.forget.is_empty() {
        return Ok(given);
    }
    let mut all = match given {
        Some(given) => given,
        None => api.example(id).await?.landmarks,
    };
    for name in &args.forget {
        let at = all.iter().position(|landmark| landmark.name == *name);
        let at = at.ok_or_else(|| ClientError::NoSuchLandmark {
            found: name.clone(),
            known: all.iter().map(|landmark| landmark.name.as_str()).collect::<Vec<_>>().join(", "),
        })?;
        all.remove(at);
    }
    for spec in &args.landmark {
        match all.iter_mut().find(|landmark| landmark.name == spec.0.name) {
            Some(landmark) => landmark.clone_from(&spec.0),
            None => all.push(spec.0.clone()),
        }
    }
    Ok(Some(all))
}
