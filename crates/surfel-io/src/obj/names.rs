//! File names in OBJ and MTL statements. A statement may have several names, names with blanks, and options before or
//! after them. Text that names an existing file is a name.

use crate::files::Siblings;

/// Maximum number of words of a library's name. It also limits the search for the name of an existing file in a texture
/// statement. The name begins at one of the first `MAX_WORDS` words, or after the options, and at most `MAX_WORDS`
/// words follow it.
const MAX_WORDS: usize = 12;
/// Maximum number of libraries that are read from a statement; further ones are ignored.
const MAX_LIBRARIES: usize = 64;

/// Options of texture statements (MTL specification), and the maximum number of words that follow each option. Where
/// three numbers may follow, only the first is required.
const OPTIONS: [(&str, usize); 15] = [
    ("-blendu", 1),
    ("-blendv", 1),
    ("-boost", 1),
    ("-bm", 1),
    ("-cc", 1),
    ("-clamp", 1),
    ("-colorspace", 1),
    ("-imfchan", 1),
    ("-mm", 2),
    ("-o", 3),
    ("-s", 3),
    ("-t", 3),
    ("-texopt", 1),
    ("-texres", 1),
    ("-type", 1),
];

/// File name in a texture statement, and those of its options whose effect is missed because Surfel ignores them.
#[derive(Debug, PartialEq)]
pub(super) struct Map<'a> {
    pub(super) name: &'a str,
    /// Options that move or scale the texture, with their numbers, for a note.
    pub(super) moved: Option<String>,
}

/// Returns a name with percent-encoding decoded; `None` if the result is empty, no text, or the same name.
pub(super) fn decoded(name: &str) -> Option<String> {
    let decoded = percent_encoding::percent_decode_str(name).decode_utf8().unwrap_or_default();
    (!decoded.is_empty() && decoded != name).then(|| decoded.into_owned())
}

/// True if a file of this name, or of its percent-decoded name, exists.
pub(super) fn exists(name: &str, siblings: &Siblings) -> bool {
    !name.is_empty() && (siblings.has(name) || decoded(name).is_some_and(|decoded| siblings.has(&decoded)))
}

/// Returns the names of libraries in an `mtllib` statement: one name, which may contain blanks, or several.
pub(super) fn libraries(statement: &str, siblings: &Siblings) -> Vec<String> {
    libraries_among(statement, |name| exists(name, siblings))
}

fn libraries_among(statement: &str, exists: impl Fn(&str) -> bool) -> Vec<String> {
    let words = words(statement);
    if words.len() < 2 || exists(statement) {
        return vec![statement.to_owned()];
    }
    let (mut found, mut any, mut first) = (Vec::new(), false, 0);
    while first < words.len() && found.len() < MAX_LIBRARIES {
        let last = words.len().min(first + MAX_WORDS);
        let longest = (first + 1..=last).rev().find(|end| exists(part(statement, &words[first..*end])));
        any |= longest.is_some();
        // A missing library's name ends with its extension.
        let is_end = |end: &usize| part(statement, &words[first..*end]).to_ascii_lowercase().ends_with(".mtl");
        let end = longest.or_else(|| (first + 1..=last).find(is_end)).unwrap_or(words.len());
        found.push(part(statement, &words[first..end]).to_owned());
        first = end;
    }
    let are_names = any || found.iter().all(|name| name.to_ascii_lowercase().ends_with(".mtl"));
    if are_names { found } else { vec![statement.to_owned()] }
}

/// Returns the file of a texture statement, which may have options before and after the name. The name is a part of the
/// statement that is an existing file. Among several parts, those that end last are preferred; among these, the one
/// that begins right after the options, or else the longest. If no part is an existing file, the name is the text after
/// the options.
pub(super) fn map(statement: &str, exists: impl Fn(&str) -> bool) -> Map<'_> {
    let words = words(statement);
    let first = after_options(statement, &words);
    let ends = words.len().saturating_sub(MAX_WORDS).max(1)..=words.len();
    let found = ends.rev().find_map(|end| {
        let starts = 0..end.min(MAX_WORDS);
        // The longest part, but preferably the one that starts after the options' words.
        let of_file = |start: &usize| exists(part(statement, &words[*start..end]));
        std::iter::once(first).filter(|first| *first < end).chain(starts).find(of_file).map(|start| start..end)
    });
    let range = found.unwrap_or(first..words.len());
    let name = part(statement, &words[range.clone()]);
    let options = words[..range.start].iter().chain(&words[range.end..]).map(|range| &statement[range.clone()]);
    Map { name, moved: moved(&options.collect::<Vec<_>>()) }
}

/// Returns the number of words at the start of a texture statement that are options and their arguments.
fn after_options(statement: &str, words: &[std::ops::Range<usize>]) -> usize {
    let word = |i: usize| words.get(i).map_or("", |range| &statement[range.clone()]);
    let mut next = 0;
    while next + 1 < words.len() && word(next).starts_with('-') {
        let option = word(next).to_ascii_lowercase();
        next += 1;
        let known = OPTIONS.iter().find(|(name, _)| *name == option);
        let most = known.map_or(usize::MAX, |(_, most)| *most);
        let is_number = |i: usize| word(i).parse::<f64>().is_ok();
        // The last word is the file. Words that look like arguments belong to an unknown option.
        for taken in 0..most {
            let is_taken = match most {
                1 => true,
                usize::MAX => is_number(next) || taken == 0 && !is_image(word(next)) && !word(next).starts_with('-'),
                _ => is_number(next),
            };
            if !is_taken || next + 1 >= words.len() {
                break;
            }
            next += 1;
        }
    }
    next
}

/// True if a name has the extension of an image.
fn is_image(name: &str) -> bool {
    const EXTENSIONS: [&str; 14] =
        ["png", "jpg", "jpeg", "webp", "tga", "bmp", "tif", "tiff", "gif", "dds", "exr", "hdr", "ktx", "ktx2"];
    name.rsplit_once('.').is_some_and(|(_, extension)| EXTENSIONS.iter().any(|e| extension.eq_ignore_ascii_case(e)))
}

/// Returns the options that move or scale a texture, with their numbers, if there are any with an effect.
fn moved(options: &[&str]) -> Option<String> {
    let mut all = Vec::new();
    for (i, option) in options.iter().enumerate() {
        let none = match option.to_ascii_lowercase().as_str() {
            "-o" | "-t" => 0.0,
            "-s" => 1.0,
            _ => continue,
        };
        let numbers: Vec<&str> =
            options[i + 1..].iter().copied().take(3).take_while(|word| word.parse::<f64>().is_ok()).collect();
        if numbers.iter().any(|word| word.parse() != Ok(none)) {
            all.push(format!("{option} {}", numbers.join(" ")));
        }
    }
    (!all.is_empty()).then(|| all.join(" "))
}

/// Returns the byte range of each word in a statement.
fn words(statement: &str) -> Vec<std::ops::Range<usize>> {
    let start = |word: &str| word.as_ptr() as usize - statement.as_ptr() as usize;
    statement.split_whitespace().map(|word| start(word)..start(word) + word.len()).collect()
}

/// Returns the text of a statement from the first of `words` to the last.
fn part<'a>(statement: &'a str, words: &[std::ops::Range<usize>]) -> &'a str {
    match (words.first(), words.last()) {
        (Some(first), Some(last)) => &statement[first.start..last.end],
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_are_one_with_blanks_or_several() {
        let among = |statement: &str, files: &[&str]| libraries_among(statement, |name| files.contains(&name));
        assert_eq!(among("a.mtl", &[]), ["a.mtl"]);
        assert_eq!(among("one.mtl two.mtl", &["one.mtl", "two.mtl"]), ["one.mtl", "two.mtl"]);
        assert_eq!(among("one.mtl  two.mtl", &["two.mtl"]), ["one.mtl", "two.mtl"]);
        assert_eq!(among("one.mtl two.mtl", &[]), ["one.mtl", "two.mtl"]);
        assert_eq!(among("my file.mtl", &["my file.mtl"]), ["my file.mtl"]);
        assert_eq!(among("my file.mtl", &[]), ["my file.mtl"]);
        assert_eq!(
            among("my file.mtl b.mtl c d.mtl", &["my file.mtl", "c d.mtl"]),
            ["my file.mtl", "b.mtl", "c d.mtl"]
        );
        assert_eq!(among("a b", &["b"]), ["a b"], "one name without an extension");
        assert_eq!(among(&"x ".repeat(100_000), &[]).len(), 1, "in no time");
    }

    #[test]
    fn textures_have_any_options_before_and_after_them() {
        let among = |statement: &'static str, files: &[&str]| map(statement, |name| files.contains(&name)).name;
        for (statement, name) in [
            ("tex.png", "tex.png"),
            ("my tex.png", "my tex.png"),
            ("-colorspace sRGB tex.png", "tex.png"),
            ("-s 1 1 1 -o 0 0 0 tex.png", "tex.png"),
            ("-s 2 tex.png", "tex.png"),
            ("-mm 0 1 -clamp on my tex.png", "my tex.png"),
            ("-imfchan r tex.png", "tex.png"),
            ("-foo one tex.png", "tex.png"),
            ("-foo tex.png", "tex.png"),
            ("-foo 1 2 3 -bar x tex.png", "tex.png"),
            ("-type sphere tex.png", "tex.png"),
            ("-O 1 2 3 7.png", "7.png"),
        ] {
            assert_eq!((among(statement, &[name]), among(statement, &[])), (name, name), "{statement}");
        }
        assert_eq!(among("-foo one two my tex.png", &["my tex.png"]), "my tex.png");
        assert_eq!(among("-s 1 2 3 4.png", &["3 4.png", "4.png"]), "4.png", "numbers belong to their option");
        assert_eq!(among("tex.png -bm 0.5", &["tex.png"]), "tex.png");
        assert_eq!(among("-odd name.png", &["-odd name.png"]), "-odd name.png");
        assert_eq!(among("", &[]), "");
        let moved = |statement| map(statement, |_| false).moved;
        assert_eq!(moved("-s 1 1 1 -o 0 0 t.png"), None);
        assert_eq!(moved("-s 2 2 -clamp on -o 0 0.5 t.png").as_deref(), Some("-s 2 2 -o 0 0.5"));
    }
}
