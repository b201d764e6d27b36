//! Lists in pages: newest first, an opaque cursor to the next page.

use super::Problem;
use crate::store::{Page, PageRequest};
use base64::Engine;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;
use serde::Deserialize;
use utoipa::IntoParams;

/// Most items of a page.
pub const MAX_LIMIT: u32 = 200;
/// Items of a page unless asked otherwise.
pub const DEFAULT_LIMIT: u32 = 50;

/// Which page of a list.
#[derive(Debug, Clone, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// `next_cursor` of the page before.
    pub cursor: Option<String>,
    /// Items per page.
    #[param(minimum = 1, maximum = 200, default = 50)]
    pub limit: Option<u32>,
}

impl PageQuery {
    /// The page as the store wants it. Errors: a limit outside its interval, a cursor that is none of ours.
    pub fn request(&self) -> Result<PageRequest, Problem> {
        let limit = self.limit.unwrap_or(DEFAULT_LIMIT);
        if !(1..=MAX_LIMIT).contains(&limit) {
            return Err(Problem::outside("limit", f64::from(limit), 1.0, f64::from(MAX_LIMIT)));
        }
        let before = match &self.cursor {
            None => None,
            Some(cursor) => Some(read(cursor).ok_or_else(|| {
                Problem::out_of_range(format!("cursor {cursor:?} is not a next_cursor of this service"))
            })?),
        };
        Ok(PageRequest { before, limit })
    }
}

fn read(cursor: &str) -> Option<i64> {
    let bytes = BASE64_URL_SAFE_NO_PAD.decode(cursor).ok()?;
    String::from_utf8(bytes).ok()?.strip_prefix("before:")?.parse().ok()
}

/// The cursor of the next page.
pub fn next_cursor<T>(page: &Page<T>) -> Option<String> {
    page.next.map(|seq| BASE64_URL_SAFE_NO_PAD.encode(format!("before:{seq}")))
}

/// Makes the body type of a page of some items (a named schema reads better in the contract than a generic one).
macro_rules! page_of {
    ($(#[$doc:meta])* $page:ident, $item:ty, $row:ty) => {
        $(#[$doc])*
        #[derive(Debug, serde::Serialize, utoipa::ToSchema)]
        pub struct $page {
            /// The items.
            pub items: Vec<$item>,
            /// Pass it as `cursor` to get the next page; null on the last one.
            #[schema(required)]
            pub next_cursor: Option<String>,
        }

        impl TryFrom<crate::store::Page<$row>> for $page {
            type Error = $crate::http::Problem;

            fn try_from(page: crate::store::Page<$row>) -> Result<Self, Self::Error> {
                let next_cursor = $crate::http::pages::next_cursor(&page);
                let items = page.items.into_iter().map(<$item>::try_from).collect::<Result<_, _>>();
                Ok(Self { items: items.map_err($crate::http::Problem::from)?, next_cursor })
            }
        }
    };
}
pub(crate) use page_of;

impl From<std::convert::Infallible> for Problem {
    fn from(never: std::convert::Infallible) -> Self {
        match never {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_leads_to_the_page_after_it() {
        let page = Page { items: vec![()], next: Some(7) };
        let query = PageQuery { cursor: next_cursor(&page), limit: None };
        assert_eq!(query.request().unwrap().before, Some(7));
        assert!(PageQuery { cursor: Some("Nw".into()), limit: None }.request().is_err());
        assert!(PageQuery { cursor: None, limit: Some(201) }.request().is_err());
    }
}
