//! Deserializes TOML documents by serde, with structured errors.
//!
//! The `toml` crate's own deserializer ignores surplus elements of arrays, and its errors are text. This one checks the
//! length of arrays, and its errors have the line, the key and the accepted names.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Display;

use serde::de::value::StrDeserializer;
use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, Error as _, Expected, MapAccess, SeqAccess,
    Unexpected, VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::words::escaped;

/// Where and why a document cannot be read.
#[derive(Debug)]
pub(super) struct Fault {
    /// From 1.
    pub line: usize,
    /// The path of keys, such as `object 'ring'.scale`; empty at the top level.
    pub key: String,
    pub problem: Problem,
}

/// What is wrong.
#[derive(Debug)]
pub(super) enum Problem {
    /// An unknown key or name.
    Unknown { what: &'static str, word: String, known: &'static [&'static str] },
    /// Anything else.
    Other(String),
}

/// Reads a document.
pub(super) fn parse<T: DeserializeOwned>(text: &str) -> Result<(T, KeyLines), Fault> {
    let at_line = |offset: usize| text[..offset.min(text.len())].matches('\n').count() + 1;
    let root = DeTable::parse(text).map_err(|error| Fault {
        line: error.span().map_or(1, |span| at_line(span.start)),
        key: String::new(),
        problem: Problem::Other(error.message().replace('\n', " ")),
    })?;
    let value = T::deserialize(Table(root.get_ref())).map_err(|error| Fault {
        line: error.offset.map_or(1, at_line),
        key: error.key(),
        problem: error.problem,
    })?;
    let mut lines = KeyLines::default();
    lines.add_table("", root.get_ref(), &at_line);
    Ok((value, lines))
}

/// The lines of a document's keys, by path (such as `object.0.scale`).
#[derive(Clone, Debug, Default)]
pub(super) struct KeyLines(HashMap<String, usize>);

impl KeyLines {
    /// The line of a key, or of the nearest enclosing table that exists.
    pub fn line_of(&self, path: &str) -> usize {
        let mut path = path;
        loop {
            match (self.0.get(path), path.rsplit_once('.')) {
                (Some(line), _) => return *line,
                (None, Some((around, _))) => path = around,
                (None, None) => return 1,
            }
        }
    }

    fn add_table(&mut self, path: &str, table: &DeTable, at_line: &impl Fn(usize) -> usize) {
        for (key, value) in table {
            let path = if path.is_empty() { key.get_ref().to_string() } else { format!("{path}.{}", key.get_ref()) };
            match value.get_ref() {
                DeValue::Table(table) => self.add_table(&path, table, at_line),
                DeValue::Array(array) => self.add_array(&path, array, at_line),
                _ => {}
            }
            self.0.insert(path, at_line(key.span().start));
        }
    }

    fn add_array(&mut self, path: &str, array: &DeArray, at_line: &impl Fn(usize) -> usize) {
        for (index, element) in array.iter().enumerate() {
            if let DeValue::Table(table) = element.get_ref() {
                let path = format!("{path}.{index}");
                self.add_table(&path, table, at_line);
                self.0.insert(path, at_line(element.span().start));
            }
        }
    }
}

/// An error being propagated: every enclosing table adds its key.
#[derive(Debug)]
struct Error {
    offset: Option<usize>,
    /// Innermost first; elements of arrays start with a space.
    keys: Vec<String>,
    problem: Problem,
}

impl Error {
    fn at(mut self, offset: usize) -> Self {
        self.offset.get_or_insert(offset);
        self
    }

    fn under(mut self, key: String) -> Self {
        self.keys.push(key);
        self
    }

    fn key(&self) -> String {
        let mut path = String::new();
        for key in self.keys.iter().rev() {
            if !path.is_empty() && !key.starts_with(' ') {
                path.push('.');
            }
            path.push_str(key);
        }
        escaped(&path)
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.problem {
            Problem::Unknown { what, word, .. } => write!(f, "unknown {what} '{word}'"),
            Problem::Other(message) => f.write_str(message),
        }
    }
}

impl std::error::Error for Error {}

impl serde::de::Error for Error {
    fn custom<T: Display>(message: T) -> Self {
        Self { offset: None, keys: Vec::new(), problem: Problem::Other(message.to_string()) }
    }

    fn invalid_type(found: Unexpected, expected: &dyn Expected) -> Self {
        Self::custom(format!("is {found}, but must be {}", in_words(expected)))
    }

    fn invalid_value(found: Unexpected, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        Self::custom(format!("has {length} elements, but must be {}", in_words(expected)))
    }

    fn unknown_field(field: &str, known: &'static [&'static str]) -> Self {
        let problem = Problem::Unknown { what: "key", word: escaped(field), known };
        Self { offset: None, keys: Vec::new(), problem }
    }

    fn unknown_variant(variant: &str, known: &'static [&'static str]) -> Self {
        let problem = Problem::Unknown { what: "value", word: escaped(variant), known };
        Self { offset: None, keys: Vec::new(), problem }
    }

    fn missing_field(field: &'static str) -> Self {
        Self::custom(format!("the key '{field}' is missing"))
    }
}

/// Rust's type names, in words for authors of scenes.
fn in_words(expected: &dyn Expected) -> String {
    match expected.to_string().as_str() {
        "f32" | "f64" => "a number".into(),
        "u32" | "u64" | "usize" => "a whole number that is not negative".into(),
        "a boolean" => "true or false".into(),
        other => other.into(),
    }
}

/// A value of the document.
#[derive(Clone, Copy)]
struct Value<'a>(&'a Spanned<DeValue<'a>>);

/// A value that was read. Code that is generic in its visitor is compiled for each type of a table, so that it only passes these on.
enum Content<'a> {
    String(&'a str),
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Array(&'a DeArray<'a>),
    Table(&'a DeTable<'a>),
}

impl<'a> Value<'a> {
    fn offset(self) -> usize {
        self.0.span().start
    }

    fn content(self) -> Result<Content<'a>, Error> {
        match self.0.get_ref() {
            DeValue::String(text) => Ok(Content::String(text)),
            DeValue::Boolean(value) => Ok(Content::Boolean(*value)),
            DeValue::Integer(integer) => match i64::from_str_radix(integer.as_str(), integer.radix()) {
                Ok(value) => Ok(Content::Integer(value)),
                Err(_) => Err(Error::custom("is an integer of more than 64 bits")),
            },
            DeValue::Float(float) => match float.as_str().parse() {
                Ok(value) => Ok(Content::Float(value)),
                Err(_) => Err(Error::custom("is not a number")),
            },
            DeValue::Datetime(_) => Err(Error::custom("is a date, which means nothing here")),
            DeValue::Array(array) => Ok(Content::Array(array)),
            DeValue::Table(table) => Ok(Content::Table(table)),
        }
    }

    /// The value as a variant, and its word or only key; no value goes with a word.
    fn variant(self) -> Result<Variant<'a>, Error> {
        match self.0.get_ref() {
            DeValue::String(word) => Ok(Variant { name: word, value: None, offset: self.offset() }),
            DeValue::Table(table) => match (table.iter().next(), table.len()) {
                (Some((key, value)), 1) => {
                    Ok(Variant { name: key.get_ref(), value: Some(Value(value)), offset: key.span().start })
                }
                (_, count) => Err(Error::custom(format!("has {count} keys, but must have one"))),
            },
            _ => Err(Error::custom("must be a word, or a table with one key")),
        }
    }
}

impl<'de> Deserializer<'de> for Value<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        let mut elements = Elements::default();
        let visited = match self.content() {
            Ok(Content::String(text)) => visitor.visit_str(text),
            Ok(Content::Boolean(value)) => visitor.visit_bool(value),
            Ok(Content::Integer(value)) => visitor.visit_i64(value),
            Ok(Content::Float(value)) => visitor.visit_f64(value),
            Ok(Content::Array(array)) => {
                elements.rest = array.iter();
                visitor.visit_seq(&mut elements)
            }
            Ok(Content::Table(table)) => return Table(table).deserialize_any(visitor),
            Err(error) => Err(error),
        };
        match (visited, elements.surplus()) {
            (Ok(value), None) => Ok(value),
            (Ok(_), Some(error)) | (Err(error), _) => Err(error.at(self.offset())),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let variant = self.variant().map_err(|error| error.at(self.offset()))?;
        let offset = variant.offset;
        visitor.visit_enum(variant).map_err(|error| error.at(offset))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

/// A table of the document.
#[derive(Clone, Copy)]
struct Table<'a>(&'a DeTable<'a>);

impl<'de> Deserializer<'de> for Table<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_map(Entries { rest: self.0.iter(), entry: None })
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any option newtype_struct enum
    }
}

#[derive(Default)]
struct Elements<'a> {
    rest: std::slice::Iter<'a, Spanned<DeValue<'a>>>,
    /// How many were read.
    read: usize,
}

impl Elements<'_> {
    /// The error of having more than were read.
    fn surplus(&self) -> Option<Error> {
        let (has, read) = (self.read + self.rest.len(), self.read);
        (has > read).then(|| Error::custom(format!("has {has} elements, but must have {read}")))
    }

    /// An error in the last element that was read: a table goes by its name or number.
    fn within(&self, element: &Spanned<DeValue>, error: Error) -> Error {
        let error = error.at(element.span().start);
        match element.get_ref() {
            DeValue::Table(table) => match table.get("name").map(Spanned::get_ref) {
                Some(DeValue::String(name)) => error.under(format!(" '{name}'")),
                _ => error.under(format!(" {}", self.read)),
            },
            _ => error,
        }
    }
}

impl<'de> SeqAccess<'de> for &mut Elements<'_> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        let Some(element) = self.rest.next() else { return Ok(None) };
        self.read += 1;
        match seed.deserialize(Value(element)) {
            Ok(value) => Ok(Some(value)),
            Err(error) => Err(self.within(element, error)),
        }
    }
}

type Entry<'a> = (&'a Spanned<Cow<'a, str>>, &'a Spanned<DeValue<'a>>);

struct Entries<'a> {
    rest: toml::map::Iter<'a, Spanned<Cow<'a, str>>, Spanned<DeValue<'a>>>,
    /// Whose key was read.
    entry: Option<Entry<'a>>,
}

impl Error {
    fn in_value_of(self, key: &Spanned<Cow<str>>) -> Self {
        self.at(key.span().start).under(key.get_ref().to_string())
    }
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Error> {
        self.entry = self.rest.next();
        let Some((key, _)) = self.entry else { return Ok(None) };
        match seed.deserialize(StrDeserializer::new(key.get_ref())) {
            Ok(key) => Ok(Some(key)),
            Err(error) => Err(Error::at(error, key.span().start)),
        }
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Error> {
        let Some((key, value)) = self.entry.take() else { return Err(Error::custom("a value without a key")) };
        seed.deserialize(Value(value)).map_err(|error| error.in_value_of(key))
    }
}

/// `variant` or `{ variant = value }`.
struct Variant<'a> {
    name: &'a str,
    value: Option<Value<'a>>,
    offset: usize,
}

impl<'de, 'a> EnumAccess<'de> for Variant<'a> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Error> {
        let name: StrDeserializer<'a, Error> = StrDeserializer::new(self.name);
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> VariantAccess<'de> for Variant<'_> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        match self.value {
            None => Ok(()),
            Some(_) => Err(Error::custom("takes no values").under(self.name.to_owned())),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        let Some(value) = self.value else {
            return Err(Error::custom(format!("is '{}', which needs values: {{ {} = … }}", self.name, self.name)));
        };
        seed.deserialize(value).map_err(|error| error.under(self.name.to_owned()))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Error> {
        self.newtype_variant_seed(Fields(visitor))
    }

    fn struct_variant<V: Visitor<'de>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, Error> {
        self.newtype_variant_seed(Fields(visitor))
    }
}

/// A variant's fields.
struct Fields<V>(V);

impl<'de, V: Visitor<'de>> DeserializeSeed<'de> for Fields<V> {
    type Value = V::Value;

    fn deserialize<D: Deserializer<'de>>(self, fields: D) -> Result<V::Value, D::Error> {
        fields.deserialize_any(self.0)
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only errors are looked at")]
    struct Outer {
        pair: [f32; 2],
        count: Option<u32>,
        word: Option<Word>,
        #[serde(default)]
        item: Vec<Item>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    #[expect(dead_code, reason = "only errors are looked at")]
    enum Word {
        Plain,
        Sized(Item),
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only errors are looked at")]
    struct Item {
        name: Option<String>,
        size: f32,
    }

    fn fault(text: &str) -> (usize, String, String) {
        let fault = parse::<Outer>(text).unwrap_err();
        let problem = match fault.problem {
            Problem::Unknown { what, word, known } => format!("{what} {word}: {}", known.join(" ")),
            Problem::Other(message) => message,
        };
        (fault.line, fault.key, problem)
    }

    #[test]
    fn good_documents_are_read() {
        let text = "pair = [1, 2.5]\nword = { sized = { size = 3 } }\n[[item]]\nsize = 1\n[[item]]\nsize = 2\n";
        let (outer, lines) = parse::<Outer>(text).unwrap();
        assert!(outer.pair == [1.0, 2.5] && outer.item.len() == 2 && matches!(outer.word, Some(Word::Sized(_))));
        let expected = [("word.sized.size", 2), ("item.1.size", 6), ("item.1.name", 5), ("pair", 1), ("nothing", 1)];
        for (path, line) in expected {
            assert_eq!(lines.line_of(path), line, "{path}");
        }
        assert!(matches!(parse::<Outer>("pair = [1, 2]\nword = \"plain\"").unwrap().0.word, Some(Word::Plain)));
    }

    #[test]
    fn errors_have_line_key_and_reason() {
        for (text, line, key, problem) in [
            ("pair = [1, 2, 3]", 1, "pair", "has 3 elements, but must have 2"),
            ("\npair = [1]", 2, "pair", "has 1 elements, but must be an array of length 2"),
            ("pair = [1, \"x\"]", 1, "pair", "is string \"x\", but must be a number"),
            (
                "pair = [1, 2]\ncount = -1",
                2,
                "count",
                "is integer `-1`, but must be a whole number that is not negative",
            ),
            ("pair = [1, 2]\nword = \"plane\"", 2, "word", "value plane: plain sized"),
            ("pair = [1, 2]\nword = { sized = { siz = 3 } }", 2, "word.sized", "key siz: name size"),
            ("pair = [1, 2]\nword = { plain = 1 }", 2, "word.plain", "takes no values"),
            ("pair = [1, 2]\nword = \"sized\"", 2, "word", "is 'sized', which needs values: { sized = … }"),
            (
                "pair = [1, 2]\n[[item]]\nname = \"a\"\nsize = true",
                4,
                "item 'a'.size",
                "is boolean `true`, but must be a number",
            ),
            ("pair = [1, 2]\n[[item]]\n", 2, "item 1", "the key 'size' is missing"),
            ("count = 1", 1, "", "the key 'pair' is missing"),
            ("pair = 1979-05-27", 1, "pair", "is a date, which means nothing here"),
        ] {
            assert_eq!(fault(text), (line, key.to_owned(), problem.to_owned()), "{text}");
        }
        assert_eq!(fault("pair = [1, 2]\npair = 3").0, 2);
    }
}
