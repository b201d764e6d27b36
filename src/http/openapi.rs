//! The contract: `openapi.yaml`, also served, with pages to try it.

use super::problem;
use axum::Router;
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::get;
use utoipa::openapi::schema::{SchemaType, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::tag::TagBuilder;
use utoipa::openapi::{
    ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, RefOr, Schema, SecurityRequirement,
    ServerBuilder,
};
use utoipa_swagger_ui::SwaggerUi;

const DESCRIPTION: &str = "Inspects stranded wire ropes of ropeways with line cameras. Upload the frames of an acquisition, \
    train a model on intact rope, inspect, and ask for lay lengths, defects and likelihood maps.\n\n\
    Ids are UUIDs and may be chosen by the client: a repeated create is the same create. Errors are `application/problem+json` \
    (RFC 9457) with a stable `type`. Lists come in pages, newest first. Units stand in the names of fields; lay lengths are \
    signed, + is right-hand.";

/// Everything of the contract but the routes.
pub fn frame() -> OpenApi {
    let bearer = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .bearer_format("rope_<id>_<secret>")
        .description(Some("Made by `ropescope token create` or POST /api/v1/tokens"))
        .build();
    let tag = |name: &str, description: &str| TagBuilder::new().name(name).description(Some(description)).build();
    OpenApiBuilder::new()
        .info(
            InfoBuilder::new()
                .title("Ropescope")
                .version(env!("CARGO_PKG_VERSION"))
                .description(Some(DESCRIPTION))
                .license(Some(
                    LicenseBuilder::new().name("MIT OR Apache-2.0").identifier(Some("MIT OR Apache-2.0")).build(),
                ))
                .build(),
        )
        .servers(Some([ServerBuilder::new().url("/").build()]))
        .components(Some(
            ComponentsBuilder::new()
                .security_scheme("token", SecurityScheme::Http(bearer))
                .schema(problem::schema().0, problem::schema().1)
                .build(),
        ))
        .security(Some([SecurityRequirement::new("token", Vec::<String>::new())]))
        .tags(Some([
            tag("ropes", "Ropeways and ropes with their designs"),
            tag("acquisitions", "One pass of the camera head: its frames, what is missing"),
            tag("jobs", "Train and inspect; progress and cancellation"),
            tag("models", "Appearance models, versioned per rope"),
            tag("inspections", "What jobs concluded: lay lengths, line scores, pictures"),
            tag("defects", "What was found, and what people decided about it"),
            tag("history", "Lay lengths over positions and dates"),
            tag("ticketing", "Who is told about defects, and what became of it"),
            tag("tokens", "Access tokens"),
            tag("service", "The service itself"),
        ]))
        .build()
}

/// Parameters that may be left out: an `Option` says so, but also that the text `null` would do, which is not true.
pub fn absent_not_null(contract: &mut OpenApi) {
    for item in contract.paths.paths.values_mut() {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch];
        let parameters = operations.into_iter().flatten().filter_map(|o| o.parameters.as_mut()).flatten();
        for schema in parameters.filter_map(|p| match p {
            RefOr::T(parameter) => parameter.schema.as_mut(),
            RefOr::Ref(_) => None,
        }) {
            without_null(schema);
        }
    }
}

fn without_null(schema: &mut RefOr<Schema>) {
    if let RefOr::T(Schema::Object(object)) = schema
        && let SchemaType::Array(types) = &mut object.schema_type
    {
        types.retain(|t| *t != Type::Null);
        if let [only] = types.as_slice() {
            object.schema_type = SchemaType::Type(only.clone());
        }
    } else if let RefOr::T(Schema::OneOf(one_of)) = schema {
        let null = |s: &RefOr<Schema>| matches!(s, RefOr::T(Schema::Object(o)) if o.schema_type == SchemaType::Type(Type::Null));
        one_of.items.retain(|item| !null(item));
        if one_of.items.len() == 1 {
            *schema = one_of.items.remove(0);
        }
    }
}

/// The contract as it stands in `openapi.yaml`.
pub fn yaml(contract: &OpenApi) -> String {
    contract.to_yaml().unwrap_or_else(|error| format!("# {error}\n"))
}

/// `/openapi.json`, `/openapi.yaml` and `/docs`, all from this binary.
pub fn pages<S: Clone + Send + Sync + 'static>(contract: OpenApi) -> Router<S> {
    let text = yaml(&contract);
    let answer = move || {
        let text = text.clone();
        async move { ([(header::CONTENT_TYPE, "application/yaml")], text).into_response() }
    };
    Router::new().merge(SwaggerUi::new("/docs").url("/openapi.json", contract)).route("/openapi.yaml", get(answer))
}
