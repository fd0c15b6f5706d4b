//! Conditions on attributes: comparisons with numbers, joined by `and`, `or`, `not` and parentheses.
//!
//! ```text
//! any        = all { ("or" | "||") all }
//! all        = inverted { ("and" | "&&") inverted }
//! inverted   = ("not" | "!") inverted | "(" any ")" | comparison
//! comparison = name ("<" | "<=" | ">" | ">=" | "=" | "==" | "!=") number
//! ```
//!
//! A name is one or several words, or any text in double quotes that isn't blank and has no double quote.

/// Maximum nesting depth of parentheses and `not`; deeper conditions are refused.
const MAX_DEPTH: usize = 64;
/// Largest number of characters that an error message quotes of a condition's text; `…` replaces the rest.
const QUOTED: usize = 24;
/// Example of a condition, for error messages.
const EXAMPLE: &str = "such as intensity>100 and not (z<=5 or classification=7)";

/// Operator that compares an attribute with a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Comparison {
    Less,
    AtMost,
    Greater,
    AtLeast,
    Equal,
    NotEqual,
}

impl Comparison {
    /// True if the comparison of `a` with `b` is true. Every comparison with NaN is false.
    pub fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Self::Less => a < b,
            Self::AtMost => a <= b,
            Self::Greater => a > b,
            Self::AtLeast => a >= b,
            Self::Equal => a == b,
            Self::NotEqual => a != b && !a.is_nan(),
        }
    }
}

/// A comparison of an attribute with a number.
#[derive(Clone, Debug, PartialEq)]
pub struct ConditionTerm {
    /// `x`, `y`, `z` or the name of an attribute.
    pub name: String,
    /// Operator between the attribute and the number.
    pub comparison: Comparison,
    /// Number that the attribute is compared with; not NaN.
    pub value: f64,
}

/// A condition on the attributes of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    terms: Vec<ConditionTerm>,
    root: Node,
}

/// Node of a condition's syntax tree, whose leaves are comparisons.
#[derive(Clone, Debug, PartialEq)]
enum Node {
    /// Index of a comparison in [`Condition::terms`].
    Term(usize),
    /// Condition that is true if the inner one is false.
    Not(Box<Node>),
    /// Condition that is true if all inner ones are true.
    All(Vec<Node>),
    /// Condition that is true if any inner one is true.
    Any(Vec<Node>),
}

impl Condition {
    /// Parses a condition such as `intensity>100 and not (z<=5 or classification=7)`. `not` has the highest precedence,
    /// then `and`, then `or`.
    ///
    /// # Errors
    /// A message that states what was found, at which character (counted from 1), and what is expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parser = Parser { text, at: 0, terms: Vec::new() };
        let root = parser.any(0)?;
        match parser.peek()? {
            (Token::End, _) => Ok(Self { terms: parser.terms, root }),
            (_, at) => Err(parser.wrong(at, "'and', 'or' or the end")),
        }
    }

    /// Returns the text of a condition that is true where all conditions in `texts` are true.
    pub fn all<S: AsRef<str>>(texts: &[S]) -> String {
        match texts {
            [one] => one.as_ref().trim().to_owned(),
            all => all.iter().map(|text| format!("({})", text.as_ref().trim())).collect::<Vec<_>>().join(" and "),
        }
    }

    /// Returns the comparisons, in the order of the text.
    pub fn terms(&self) -> &[ConditionTerm] {
        &self.terms
    }

    /// True if the condition is true of a point. `value(i)` returns the point's value of the attribute in term `i` of
    /// [`Self::terms`].
    pub fn holds(&self, value: &dyn Fn(usize) -> f64) -> bool {
        self.node_holds(&self.root, value)
    }

    fn node_holds(&self, node: &Node, value: &dyn Fn(usize) -> f64) -> bool {
        match node {
            Node::Term(i) => {
                let term = &self.terms[*i];
                term.comparison.holds(value(*i), term.value)
            }
            Node::Not(node) => !self.node_holds(node, value),
            Node::All(nodes) => nodes.iter().all(|node| self.node_holds(node, value)),
            Node::Any(nodes) => nodes.iter().any(|node| self.node_holds(node, value)),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    Word(&'a str),
    Quoted(&'a str),
    Compare(Comparison),
    And,
    Or,
    Not,
    Open,
    Close,
    End,
}

struct Parser<'a> {
    text: &'a str,
    /// Byte offset of the next token in the text.
    at: usize,
    terms: Vec<ConditionTerm>,
}

impl<'a> Parser<'a> {
    fn any(&mut self, depth: usize) -> Result<Node, String> {
        let mut nodes = vec![self.all(depth)?];
        while self.takes(Token::Or)? {
            nodes.push(self.all(depth)?);
        }
        Ok(if nodes.len() == 1 { nodes.remove(0) } else { Node::Any(nodes) })
    }

    fn all(&mut self, depth: usize) -> Result<Node, String> {
        let mut nodes = vec![self.inverted(depth)?];
        while self.takes(Token::And)? {
            nodes.push(self.inverted(depth)?);
        }
        Ok(if nodes.len() == 1 { nodes.remove(0) } else { Node::All(nodes) })
    }

    fn inverted(&mut self, depth: usize) -> Result<Node, String> {
        let (token, at) = self.peek()?;
        if matches!(token, Token::Not | Token::Open) && depth == MAX_DEPTH {
            return Err(self.wrong(at, &format!("at most {MAX_DEPTH} parentheses and 'not' within each other")));
        }
        if self.takes(Token::Not)? {
            return Ok(Node::Not(Box::new(self.inverted(depth + 1)?)));
        }
        if self.takes(Token::Open)? {
            let node = self.any(depth + 1)?;
            let (_, at) = self.peek()?;
            return if self.takes(Token::Close)? { Ok(node) } else { Err(self.wrong(at, "'and', 'or' or ')'")) };
        }
        self.comparison()
    }

    fn comparison(&mut self) -> Result<Node, String> {
        let name = self.name()?;
        let (token, at) = self.next()?;
        let Token::Compare(comparison) = token else { return Err(self.wrong(at, "one of < <= > >= = !=")) };
        let (token, at) = self.next()?;
        let number = if let Token::Word(word) = token { word.parse::<f64>().ok() } else { None };
        let value = number.filter(|v| !v.is_nan()).ok_or_else(|| self.wrong(at, "a number"))?;
        self.terms.push(ConditionTerm { name: name.to_owned(), comparison, value });
        Ok(Node::Term(self.terms.len() - 1))
    }

    /// Parses the name of an attribute: one or several words, or a quoted text.
    fn name(&mut self) -> Result<&'a str, String> {
        match self.next()? {
            (Token::Quoted(name), _) if !name.trim().is_empty() => Ok(name.trim()),
            (Token::Word(_), start) => {
                let mut end = self.at;
                while matches!(self.peek()?.0, Token::Word(_)) {
                    self.next()?;
                    end = self.at;
                }
                Ok(&self.text[start..end])
            }
            (_, at) => Err(self.wrong(at, &format!("a comparison of an attribute with a number, {EXAMPLE}"))),
        }
    }

    fn takes(&mut self, token: Token<'_>) -> Result<bool, String> {
        let is_next = self.peek()?.0 == token;
        if is_next {
            self.next()?;
        }
        Ok(is_next)
    }

    /// Returns the next token and the byte at which it begins, without consuming it.
    fn peek(&mut self) -> Result<(Token<'a>, usize), String> {
        let at = self.at;
        let found = self.next();
        self.at = at;
        found
    }

    /// Consumes the next token, and returns the token with the byte at which it begins.
    fn next(&mut self) -> Result<(Token<'a>, usize), String> {
        const SIGNS: [(&str, Token<'static>); 12] = [
            ("<=", Token::Compare(Comparison::AtMost)),
            (">=", Token::Compare(Comparison::AtLeast)),
            ("==", Token::Compare(Comparison::Equal)),
            ("!=", Token::Compare(Comparison::NotEqual)),
            ("&&", Token::And),
            ("||", Token::Or),
            ("<", Token::Compare(Comparison::Less)),
            (">", Token::Compare(Comparison::Greater)),
            ("=", Token::Compare(Comparison::Equal)),
            ("!", Token::Not),
            ("(", Token::Open),
            (")", Token::Close),
        ];
        let text = self.text;
        let rest = text[self.at..].trim_start();
        let start = text.len() - rest.len();
        if let Some((sign, token)) = SIGNS.into_iter().find(|(sign, _)| rest.starts_with(sign)) {
            self.at = start + sign.len();
            return Ok((token, start));
        }
        if let Some(quoted) = rest.strip_prefix('"') {
            let length = quoted.find('"').ok_or_else(|| self.wrong(start, "a second '\"', which ends the name"))?;
            self.at = start + length + 2;
            return Ok((Token::Quoted(&quoted[..length]), start));
        }
        let ends = |c: char| c.is_whitespace() || "<>=!&|()\"".contains(c);
        let word = &rest[..rest.find(ends).unwrap_or(rest.len())];
        if word.is_empty() && !rest.is_empty() {
            return Err(self.wrong(start, "'&&' or '||'"));
        }
        self.at = start + word.len();
        let keywords = [("and", Token::And), ("or", Token::Or), ("not", Token::Not), ("", Token::End)];
        let keyword = keywords.into_iter().find(|(name, _)| word.eq_ignore_ascii_case(name));
        Ok((keyword.map_or(Token::Word(word), |(_, token)| token), start))
    }

    /// Formats an error message about the text at the byte offset `at`.
    fn wrong(&self, at: usize, expected: &str) -> String {
        let rest = self.text[at..].trim_end();
        let character = self.text[..at].chars().count() + 1;
        if rest.is_empty() {
            let end = self.text.trim_end().chars().count();
            return format!("ends after character {end}, expected {expected}");
        }
        let quoted: String = rest.chars().take(QUOTED).collect();
        let more = if quoted.len() < rest.len() { "…" } else { "" };
        format!("has '{}{more}' at character {character}, expected {expected}", quoted.escape_debug())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comparisons_have_names_of_one_or_several_words() {
        let parsed = Condition::parse(" intensity>100 AND band <= -2.5e1 and Return  Number != 3 and a==1").unwrap();
        let is = |name: &str, comparison, value| ConditionTerm { name: name.into(), comparison, value };
        let expected = [
            is("intensity", Comparison::Greater, 100.0),
            is("band", Comparison::AtMost, -25.0),
            is("Return  Number", Comparison::NotEqual, 3.0),
            is("a", Comparison::Equal, 1.0),
        ];
        assert_eq!(parsed.terms(), expected);
        let quoted = Condition::parse("\"not (a)\"<1||größe>=inf").unwrap();
        assert_eq!(quoted.terms()[0], is("not (a)", Comparison::Less, 1.0));
        assert_eq!(quoted.terms()[1], is("größe", Comparison::AtLeast, f64::INFINITY));
    }

    #[test]
    fn errors_say_at_which_character() {
        for (text, part) in [
            ("", "ends after character 0, expected a comparison"),
            ("intensity", "ends after character 9, expected one of <"),
            ("intensity> ", "ends after character 10, expected a number"),
            (">3", "has '>3' at character 1, expected a comparison"),
            ("ä>1 an b<2", "has 'an b<2' at character 5, expected 'and', 'or' or the end"),
            ("a>b", "has 'b' at character 3, expected a number"),
            ("a>nan", "has 'nan' at character 3, expected a number"),
            ("a>1 and", "ends after character 7, expected a comparison"),
            ("a>1 & b<2", "has '& b<2' at character 5, expected '&&' or '||'"),
            ("a!3", "has '!3' at character 2, expected one of <"),
            ("(a>1", "ends after character 4, expected 'and', 'or' or ')'"),
            ("a>1)", "has ')' at character 4, expected 'and', 'or' or the end"),
            ("()", "has ')' at character 2, expected a comparison"),
            ("not", "ends after character 3, expected a comparison"),
            ("and", "has 'and' at character 1, expected a comparison"),
            ("\"a>1", "has '\\\"a>1' at character 1, expected a second"),
            ("\" \">1", "at character 1, expected a comparison"),
            ("1<a<5", "has 'a<5' at character 3, expected a number"),
            ("a>1 b>2 and ccccccccccccccccccccccccccccccccccccc>1", "has 'b>2 and cccccccccccccccc…' at character 5"),
        ] {
            let error = Condition::parse(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn nesting_is_bounded_and_chains_are_not() {
        let nested = |depth: usize| format!("{}a>1{}", "(".repeat(depth), ")".repeat(depth));
        assert!(Condition::parse(&nested(MAX_DEPTH)).is_ok());
        let error = Condition::parse(&nested(100_000)).unwrap_err();
        assert!(error.contains("at character 65, expected at most 64 parentheses"), "{error}");
        assert!(Condition::parse(&("!".repeat(65) + "a>1")).is_err());
        let chain = Condition::parse(&vec!["a>1"; 50_000].join(" or ")).unwrap();
        assert!(!chain.holds(&|_| 0.0) && chain.holds(&|i| if i == 49_999 { 2.0 } else { 0.0 }));
    }

    #[test]
    fn conditions_that_must_all_hold_are_joined() {
        let joined = Condition::all(&["a>1 or b>1", " c>1 "]);
        assert_eq!(joined, "(a>1 or b>1) and (c>1)");
        assert!(!Condition::parse(&joined).unwrap().holds(&|i| [2.0, 0.0, 0.0][i]));
        assert_eq!(Condition::all(&[" a>1 or b>1"]), "a>1 or b>1");
    }

    #[test]
    fn no_comparison_holds_for_what_is_no_number() {
        for sign in ["<", "<=", ">", ">=", "=", "!="] {
            assert!(!Condition::parse(&format!("a{sign}1")).unwrap().holds(&|_| f64::NAN), "{sign}");
            assert!(Condition::parse(&format!("not a{sign}1")).unwrap().holds(&|_| f64::NAN), "{sign}");
        }
    }

    /// A condition as a tree whose leaves are indices of attributes, `aN>0`.
    enum Tree {
        Leaf(usize),
        Not(Box<Tree>),
        All(Box<Tree>, Box<Tree>),
        Any(Box<Tree>, Box<Tree>),
    }

    struct Random(u64);

    impl Random {
        fn below(&mut self, n: usize) -> usize {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) as usize % n
        }

        fn tree(&mut self, depth: usize) -> Tree {
            let (kind, leaf) = (self.below(4), self.below(LEAVES));
            let mut part = || Box::new(self.tree(depth - 1));
            match kind {
                _ if depth == 0 => Tree::Leaf(leaf),
                0 => Tree::Not(part()),
                1 => Tree::All(part(), part()),
                2 => Tree::Any(part(), part()),
                _ => Tree::Leaf(leaf),
            }
        }

        /// Writes the condition in a random way, with the parentheses that precedence needs and occasionally others.
        /// `strength` is the precedence of the surrounding operator: 0 for `or` or none, 1 for `and`, 2 for `not`.
        fn write(&mut self, tree: &Tree, strength: usize) -> String {
            let space = [" ", "  ", "\t"][self.below(3)];
            let (own, text) = match tree {
                Tree::Leaf(i) => (3, format!("a{i}{space}>{space}0")),
                Tree::Not(part) => {
                    let sign = ["not ", "NOT ", "!", "! "][self.below(4)];
                    (2, format!("{sign}{}", self.write(part, 2)))
                }
                Tree::All(a, b) => {
                    let sign = [" and ", " AND ", "&&", " && "][self.below(4)];
                    (1, self.write(a, 1) + sign + &self.write(b, 1))
                }
                Tree::Any(a, b) => {
                    let sign = [" or ", " Or ", "||", " || "][self.below(4)];
                    (0, self.write(a, 0) + sign + &self.write(b, 0))
                }
            };
            if own < strength || self.below(8) == 0 { format!("({space}{text})") } else { text }
        }
    }

    const LEAVES: usize = 5;

    fn holds(tree: &Tree, set: usize) -> bool {
        match tree {
            Tree::Leaf(i) => set >> i & 1 == 1,
            Tree::Not(part) => !holds(part, set),
            Tree::All(a, b) => holds(a, set) && holds(b, set),
            Tree::Any(a, b) => holds(a, set) || holds(b, set),
        }
    }

    #[test]
    fn random_conditions_hold_where_their_trees_do() {
        let mut random = Random(7);
        for depth in 0..=5 {
            for _ in 0..200 {
                let tree = random.tree(depth);
                let text = random.write(&tree, 0);
                let condition = Condition::parse(&text).unwrap_or_else(|e| panic!("{text}: {e}"));
                let attribute = |term: usize| condition.terms()[term].name[1..].parse::<usize>().unwrap();
                for set in 0..1 << LEAVES {
                    let value = |term: usize| f64::from((set >> attribute(term) & 1) as u32);
                    assert_eq!(condition.holds(&value), holds(&tree, set), "{text} of {set:b}");
                }
            }
        }
    }

    #[test]
    fn damaged_conditions_are_read_or_refused() {
        let mut random = Random(11);
        let letters: Vec<char> = "a1 ()<>=!&|\"oändnot.-\u{3000}".chars().collect();
        for _ in 0..20_000 {
            let length = random.below(24);
            let text: String = (0..length).map(|_| letters[random.below(letters.len())]).collect();
            if let Err(error) = Condition::parse(&text) {
                assert!(error.contains("expected"), "{text}: {error}");
            }
        }
    }
}
