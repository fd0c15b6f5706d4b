//! Samples of a scene's objects, which all estimates share.

use crate::equal::{MOST, are_equal, one_part};
use crate::patches::Patches;
use std::borrow::Cow;
use std::sync::OnceLock;
use surfel_model::Object;

/// Samples of the surfaces of a scene's objects. Each sample is computed when it is first needed.
#[derive(Debug)]
pub struct Samples {
    objects: Vec<Object>,
    all: OnceLock<Option<Patches>>,
    one: OnceLock<Option<Patches>>,
}

impl Samples {
    /// Prepares the samples of `objects`.
    pub fn new(objects: &[Object]) -> Self {
        Self { objects: objects.to_vec(), all: OnceLock::new(), one: OnceLock::new() }
    }

    /// Returns the sample of all objects together; `None` if they are too few or too small for a sample
    /// ([`Patches::of`]).
    pub fn all(&self) -> Option<&Patches> {
        self.all.get_or_init(|| Patches::of(&self.objects)).as_ref()
    }

    /// Returns the sample of the object with this index alone; `None` if there is no such object or its surface can't
    /// be sampled ([`Patches::of`]).
    pub fn of_object(&self, object: usize) -> Option<Cow<'_, Patches>> {
        match &self.objects[..] {
            [_] => self.all().map(Cow::Borrowed),
            objects => Patches::of(objects.get(object..=object)?).map(Cow::Owned),
        }
    }

    /// Returns the sample of the first object if all objects have equal shapes. Otherwise, returns the sample of one
    /// part if the scene consists of equal parts, or else that of all objects. A row of equal shapes then gets the same
    /// up axis and view as one of them.
    pub(crate) fn one(&self) -> Option<&Patches> {
        let all = self.all()?;
        let one = self.one.get_or_init(|| self.one_of_equal_objects().or_else(|| one_part(all)));
        one.as_ref().or(Some(all))
    }

    fn one_of_equal_objects(&self) -> Option<Patches> {
        if !(2..=MOST).contains(&self.objects.len()) {
            return None;
        }
        let first = self.of_object(0)?;
        let is_equal = |object| self.of_object(object).is_some_and(|other| are_equal(&first, &other));
        (1..self.objects.len()).all(is_equal).then(|| first.into_owned())
    }
}
