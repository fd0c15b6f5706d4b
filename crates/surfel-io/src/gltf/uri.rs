//! URIs of buffers and images: `data:` and relative paths.

use crate::files::Siblings;
use data_url::{DataUrl, DataUrlError};
use percent_encoding::percent_decode_str;

/// Returns the bytes that a URI contains or refers to, or the reason why they can't be read.
pub(crate) fn read(uri: &str, siblings: &Siblings) -> Result<Vec<u8>, String> {
    match DataUrl::process(uri) {
        Ok(url) => return url.decode_to_vec().map(|(data, _)| data).map_err(|_| "its base64 is damaged".into()),
        Err(DataUrlError::NoComma) => return Err("the data URI has no comma".into()),
        Err(DataUrlError::NotADataUrl) => {}
    }
    if uri.contains("://") {
        return Err("only files and data URIs are read".into());
    }
    let path = percent_decode_str(uri).decode_utf8().map_err(|_| "its name is not text")?;
    siblings.read(&path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_are_decoded() {
        // RFC 4648 §10.
        for (text, expected) in [("", ""), ("Zg==", "f"), ("Zm8", "fo"), ("Zm9v", "foo"), ("Zm9vYmFy", "foobar")] {
            let uri = format!("data:application/octet-stream;base64,{text}");
            assert_eq!(read(&uri, &Siblings::None).unwrap(), expected.as_bytes());
        }
        assert_eq!(read("data:,a%20b%", &Siblings::None).unwrap(), b"a b%");
        assert!(read("data:;base64,Z!", &Siblings::None).is_err());
        assert!(read("data:;base64,Z", &Siblings::None).is_err());
        assert!(read("data:", &Siblings::None).is_err());
        assert!(read("http://a/b", &Siblings::None).is_err());
    }
}
