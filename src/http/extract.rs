//! The one way requests are read: like axum's extractors, but what cannot be read is a [`Problem`].

use super::Problem;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use serde::de::DeserializeOwned;
use serde_json::Value;

/// A JSON body. `6.0` is read as the integer it is (JSON has one kind of number, and so has the contract).
pub struct Json<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let axum::Json(mut value) = axum::Json::<Value>::from_request(request, state).await?;
        if value.is_array() {
            // serde takes a list for a struct, field by field; the contract does not.
            return Err(Problem::malformed_body("the body is a list, but must be an object"));
        }
        whole_numbers(&mut value);
        let bytes = serde_json::to_vec(&value).map_err(Problem::failure)?;
        let axum::Json(body) = axum::Json::<T>::from_bytes(&bytes)?; // says where in the body something is wrong
        Ok(Self(body))
    }
}

/// Writes numbers like `6.0` as `6`, as far as a double holds integers exactly.
fn whole_numbers(value: &mut Value) {
    const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53
    match value {
        Value::Number(number) if number.is_f64() => {
            if let Some(x) = number.as_f64().filter(|x| x.fract() == 0.0 && x.abs() <= EXACT) {
                *number = (x as i64).into();
            }
        }
        Value::Array(items) => items.iter_mut().for_each(whole_numbers),
        Value::Object(fields) => fields.values_mut().for_each(whole_numbers),
        _ => {}
    }
}

/// Query parameters.
#[derive(FromRequestParts)]
#[from_request(via(axum::extract::Query), rejection(Problem))]
pub struct Query<T>(pub T);

/// Parts of the path.
#[derive(FromRequestParts)]
#[from_request(via(axum::extract::Path), rejection(Problem))]
pub struct Path<T>(pub T);

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        let detail = rejection.body_text();
        match rejection {
            JsonRejection::MissingJsonContentType(_) => {
                Self::unsupported_media_type("the body must be application/json")
            }
            JsonRejection::BytesRejection(_) if rejection.status() == 413 => Self::body_too_large(detail),
            JsonRejection::BytesRejection(_) => Self::body_cut_short(detail),
            JsonRejection::JsonDataError(_) | JsonRejection::JsonSyntaxError(_) => Self::malformed_body(detail),
            _ => Self::malformed_body(detail),
        }
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::malformed_query(rejection.body_text())
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::malformed_path(rejection.body_text())
    }
}
