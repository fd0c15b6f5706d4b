//! The page as one HTML file, for uses in which no server sends its parts and images.

use data_encoding::BASE64;

/// HTML of the page, as the server sends it.
const PAGE: &str = include_str!("../page/index.html");

/// Returns the page with style, script and icon included. `policy` is the page's content security policy. `before` has
/// the elements that precede the page's script and define `window.surfelSource`.
///
/// # Errors
/// A message if the page's HTML lacks the place for one of these parts.
pub(crate) fn with(policy: &str, before: &str) -> Result<String, String> {
    let mut html = PAGE.to_owned();
    let mut insert = |place: &str, with: &str| {
        let found = html.matches(place).count();
        html = html.replacen(place, with, 1);
        (found == 1).then_some(()).ok_or_else(|| format!("the page lacks a place: {place}"))
    };
    let icon = BASE64.encode(include_bytes!("../page/icon.svg"));
    insert("href=\"/icon.svg\"", &format!("href=\"data:image/svg+xml;base64,{icon}\""))?;
    let charset = "<meta charset=\"utf-8\">";
    let policy = format!("{charset}\n<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">");
    insert(charset, &policy)?;
    let style = format!("<style>\n{}</style>", include_str!("../page/view.css"));
    insert("<link rel=\"stylesheet\" href=\"/view.css\">", &style)?;
    insert("<script src=\"/view.js\" defer></script>\n", "")?;
    let script = script(include_str!("../page/view.js"));
    insert("</body>", &format!("{before}{script}</body>"))?;
    Ok(html)
}

/// Returns an HTML element that runs a script.
pub(crate) fn script(text: &str) -> String {
    format!("<script>\n{text}</script>\n")
}
